//! The encrypted ports: `--dtls` and `--tls`, with the agent's certificate.

use super::private;
use crate::options::encrypted_address;
use crate::outcome::Failure;
use replenish_agent::{Agent, AgentConfig, SecureConfig, TlsConfig};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Addresses that the agent listens at for clients that encrypt and authenticate.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Encryption")]
pub(crate) struct Ports {
    /// A UDP address for DTLS 1.2 with the pre-shared keys of --access. Without --udp no other UDP
    /// port is opened. Without a port in it 8889.
    #[arg(long, value_name = "ADDRESS", requires = "access", value_parser = encrypted_address)]
    dtls: Option<SocketAddr>,

    /// A TCP address for TLS 1.3 with the certificates of --access. Without --udp no UDP port is
    /// opened. Without a port in it 8889.
    #[arg(long, value_name = "ADDRESS", requires_all = ["access", "certificate", "key"],
          value_parser = encrypted_address)]
    tls: Option<SocketAddr>,

    /// The agent's certificate for --tls, in PEM form; its SHA-256 is shown at the start, for
    /// clients.
    #[arg(long, value_name = "FILE", requires = "tls")]
    certificate: Option<PathBuf>,

    /// The private key of --certificate, in PEM form.
    #[arg(long, value_name = "FILE", requires = "tls")]
    key: Option<PathBuf>,
}

impl Ports {
    /// Adds the ports to `config`. `plain`: a UDP port was asked for, too.
    pub(crate) fn add_to(&self, config: AgentConfig, plain: bool) -> Result<AgentConfig, Failure> {
        let tls = match (self.tls, &self.certificate, &self.key) {
            (Some(addr), Some(certificate), Some(key)) => {
                check_key(key)?;
                Some(TlsConfig {
                    addr,
                    certificate: certificate.clone(),
                    key: key.clone(),
                })
            }
            _ => None,
        };
        let secure = SecureConfig {
            dtls: self.dtls,
            tls,
        };
        Ok(AgentConfig {
            without_udp: config.without_udp || (secure.is_on() && !plain),
            secure,
            ..config
        })
    }
}

/// Refuses a private key that is not there, or that other accounts can read.
fn check_key(path: &Path) -> Result<(), Failure> {
    let checked = std::fs::metadata(path).map_err(|why| why.to_string());
    let checked = checked.and_then(|found| private::check(path, &found));
    let shown = private::shown(path);
    checked.map_err(|why| Failure::refused(format!("cannot use {shown}: {why}")))
}

/// The encrypted ports, for people.
pub(crate) fn places(agent: &Agent) -> Vec<String> {
    let dtls = agent.dtls_addr().map(|at| format!("{at} (DTLS)"));
    let print = agent.tls_fingerprint().unwrap_or_default();
    let tls = agent.tls_addr().map(|at| format!("{at} (TLS, {print})"));
    dtls.into_iter().chain(tls).collect()
}

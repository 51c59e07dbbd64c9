//! The TLS port: a listener, and the certificates that its connections go by.

use super::certificates::{self, Listed};
use super::gate::Gate;
use super::stream::TlsStream;
use crate::config::{AccessList, AgentConfig};
use crate::error::AgentError;
use crate::report::Reason;
use replenish_xrce::Nanos;
use rustls::ServerConfig;
use rustls::server::NoServerSessionStorage;
use rustls::version::TLS13;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;

/// The port.
#[derive(Debug)]
pub(in super::super) struct TlsPort {
    pub(in super::super) listener: TcpListener,
    addr: SocketAddr,
    config: Arc<ServerConfig>,
    listed: Arc<Listed>,
    gate: Gate,
    print: [u8; 32],
}

impl TlsPort {
    /// The port of `config`, if it has one.
    pub(in super::super) fn open(config: &AgentConfig) -> Result<Option<Self>, AgentError> {
        let Some(tls) = &config.secure.tls else {
            return Ok(None);
        };
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let list = config.access.clone().unwrap_or_default();
        let algorithms = provider.signature_verification_algorithms;
        let listed = Arc::new(Listed::new(list, algorithms));
        let (chain, key) = certificates::own(tls)?;
        let print = chain
            .first()
            .map(certificates::fingerprint)
            .unwrap_or_default();
        let unusable = |why: rustls::Error| AgentError::Credentials {
            path: tls.key.clone(),
            reason: match why {
                rustls::Error::InconsistentKeys(_) => {
                    format!("it is not the private key of {}", tls.certificate.display())
                }
                why => why.to_string(),
            },
        };
        let mut server = ServerConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&TLS13])
            .map_err(unusable)?
            .with_client_cert_verifier(Arc::clone(&listed) as _)
            .with_single_cert(chain, key)
            .map_err(unusable)?;
        // No client comes back without showing its certificate.
        server.session_storage = Arc::new(NoServerSessionStorage {});
        server.send_tls13_tickets = 0;
        let error = |error| AgentError::new("listen at", tls.addr, error);
        let listener = TcpListener::bind(tls.addr).map_err(error)?;
        listener.set_nonblocking(true).map_err(error)?;
        let addr = listener.local_addr().map_err(error)?;
        Ok(Some(Self {
            listener,
            addr,
            config: Arc::new(server),
            listed,
            gate: Gate::new(),
            print,
        }))
    }

    pub(in super::super) fn local_addr(&self) -> SocketAddr {
        self.addr
    }

    /// The SHA-256 of the agent's certificate.
    pub(in super::super) fn fingerprint(&self) -> [u8; 32] {
        self.print
    }

    /// A connection that may begin a handshake, while those with `others` go on.
    pub(in super::super) fn accept(
        &mut self,
        now: Nanos,
        (tcp, addr): (TcpStream, SocketAddr),
        others: impl Iterator<Item = IpAddr>,
    ) -> Result<TlsStream, Reason> {
        self.gate.admit(now, addr, others)?;
        let stream = TlsStream::new(tcp, Arc::clone(&self.config), Arc::clone(&self.listed));
        let broken = Reason::Handshake(crate::report::HandshakeError::Protocol);
        stream.map_err(|_: io::Error| broken)
    }

    /// Goes by `list` from now on.
    pub(in super::super) fn set_access(&mut self, list: &AccessList) {
        self.listed.replace(list.clone());
    }
}

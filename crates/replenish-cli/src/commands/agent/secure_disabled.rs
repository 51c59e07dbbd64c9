//! Encrypted ports in a build without the feature `secure`: their options are refused by that name.

use crate::outcome::Failure;
use replenish_agent::{Agent, AgentConfig};

/// The options, which this build does not have.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Encryption")]
pub(crate) struct Ports {
    /// Listen for DTLS: not in this build, which lacks the feature secure.
    #[arg(long)]
    dtls: Option<String>,

    /// Listen for TLS: not in this build, which lacks the feature secure.
    #[arg(long)]
    tls: Option<String>,
}

impl Ports {
    /// Refuses `--dtls` and `--tls`.
    pub(crate) fn add_to(&self, config: AgentConfig, _plain: bool) -> Result<AgentConfig, Failure> {
        if self.dtls.is_none() && self.tls.is_none() {
            return Ok(config);
        }
        Err(Failure::Usage(
            "--dtls, --tls: this program was built without encryption; build it with the feature \
             secure: cargo install replenish-cli, or in a clone cargo run --release -p \
             replenish-cli -- agent --dtls ADDRESS --access FILE"
                .into(),
        ))
    }
}

/// This build has no encrypted ports.
pub(crate) fn places(_agent: &Agent) -> Vec<String> {
    Vec::new()
}

//! The CPUs of a client and its agent: options of the benchmarks that have both.

use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::outcome::Failure;

/// The CPUs that the user chose.
#[derive(Debug, clap::Args)]
pub(super) struct AgentCpus {
    /// The CPU of the client.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// The CPU of the agent, and of the echo beside it. Default: the client's.
    #[arg(long, value_name = "CPU")]
    agent_cpu: Option<usize>,
}

impl AgentCpus {
    /// The CPUs of client and agent.
    ///
    /// # Errors
    /// The process may not use one of them.
    pub(super) fn chosen(&self) -> Result<(usize, usize), Failure> {
        cpus::check("--cpu", self.cpu)?;
        cpus::check("--agent-cpu", self.agent_cpu)?;
        let client = self.cpu.unwrap_or_else(|| Cpus::choose().measured);
        Ok((client, self.agent_cpu.unwrap_or(client)))
    }
}

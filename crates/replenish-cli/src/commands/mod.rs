//! The words of a robot's command: one module each.

mod agent;
mod doctor;
mod host;
mod latency;
mod overheads;
mod plan;
mod simulate;
mod suggest;

use crate::outcome::Outcome;

/// A word with its options.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Does a deployment file fit on its machine? The plan with its worst cases, or the reason why
    /// not
    Plan(plan::Args),
    /// Run a deployment file in virtual time and draw its schedule
    Simulate(simulate::Args),
    /// Propose budgets for a program from what its threads take while it runs
    Suggest(suggest::Args),
    /// What this machine grants to real-time threads, with advice
    Doctor(doctor::Args),
    /// The agent alone: what ping and pong talk through
    Agent(agent::Args),
}

impl Command {
    /// Runs it.
    ///
    /// # Errors
    /// Why it did not do what was asked.
    pub fn run(self) -> Outcome {
        match self {
            Self::Plan(args) => plan::run(&args),
            Self::Simulate(args) => simulate::run(&args),
            Self::Suggest(args) => suggest::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Agent(args) => agent::run(&args),
        }
    }
}

//! The words of a robot's command: one module each.
//!
//! ```text
//!   deployment  template; suggest, simulate ─► plan ─► host: what others have reserved
//!   running     run, adopt ─► foreign: threads of other programs; agent
//!   watching    top, trace, why, metrics
//!   the host    doctor ─► network, overheads ─► latency; finding: a line of its report
//! ```

mod adopt;
mod agent;
mod doctor;
mod finding;
mod foreign;
mod host;
mod latency;
mod metrics;
mod network;
mod overheads;
mod plan;
mod run;
mod simulate;
mod suggest;
mod template;
mod top;
mod trace;
mod why;

use crate::outcome::Outcome;

/// A word with its options.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Does a deployment file fit on its machine? The plan with its worst cases, or the reason why
    /// not.
    Plan(plan::Args),
    /// Run a deployment file in virtual time and draw its schedule.
    Simulate(simulate::Args),
    /// The deployment file of a program as it describes itself; nothing of it runs.
    Template(template::Args),
    /// Propose budgets for a program from what its threads take while it runs.
    Suggest(suggest::Args),
    /// Start a program and give its threads CPU budgets, without a change to the program.
    Run(run::Args),
    /// Give the threads of programs that run CPU budgets; what they had comes back at the end.
    Adopt(adopt::Args),
    /// Gives threads back what they had when its parent ends; started by `run` and `adopt`.
    #[command(hide = true)]
    Guardian(foreign::guardian::Args),
    /// Show what this machine grants to real-time threads, with advice.
    Doctor(doctor::Args),
    /// Every program of this host with its workers: budgets, what they used, exhaustions.
    Top(top::Args),
    /// The figures of every program as OpenMetrics text, once or on a loopback port.
    Metrics(metrics::Args),
    /// The last seconds of a program, running or killed, for Perfetto.
    Trace(trace::Args),
    /// Why callbacks were late: each one's response taken apart, and the change that would help.
    Why(why::Args),
    /// The agent alone: what ping and pong talk through.
    Agent(Box<agent::Args>),
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
            Self::Template(args) => template::run(&args),
            Self::Suggest(args) => suggest::run(&args),
            Self::Run(args) => run::run(&args),
            Self::Adopt(args) => adopt::run(&args),
            Self::Guardian(args) => foreign::guardian::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Top(args) => top::run(&args),
            Self::Metrics(args) => metrics::run(&args),
            Self::Trace(args) => trace::run(&args),
            Self::Why(args) => why::run(&args),
            Self::Agent(args) => agent::run(&args),
        }
    }
}

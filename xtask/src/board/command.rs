//! The words behind `cargo xtask board`, and the room that each leads to.

use super::{behaviour, bench, case, demo, executor, experiment, host, messages, noise, options};
use super::{recorder, restart, round_trip, size};
use crate::output::{Outcome, writable};
use clap::Subcommand;
use std::path::PathBuf;

/// The board's tasks.
#[derive(Subcommand)]
pub(crate) enum Board {
    /// Says what the host lacks, and how to install it; installs nothing.
    Check,
    /// Runs the board's tests: locks, budgets, waits, policies, panics, heap and stacks.
    Test {
        /// Only cases whose name contains this.
        filter: Option<String>,
        /// Also write the result as JSON.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// Prints what a context switch, a hand-off and other basic steps take, in instructions.
    Bench {
        /// Also write the result as JSON.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// The paper's test bench: the board runs pong, this machine agent and ping.
    Demo {
        /// Length of the measurement, in seconds of the board's time.
        #[arg(long, value_name = "SECONDS", default_value_t = 10,
              value_parser = clap::value_parser!(u64).range(1..=60))]
        seconds: u64,
        /// Also write the result as JSON.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// Runs an experiment on the board; fails if a count is off.
    Experiment(options::Asked),
    /// A message from the board to the host and back, beside the time of its bytes on the wire.
    RoundTrip {
        /// The line's rates, in bits per second.
        #[arg(long, value_name = "RATES", value_delimiter = ',', default_value = "115200,921600",
              value_parser = clap::value_parser!(u32).range(1_200..=4_000_000))]
        baud: Vec<u32>,
        /// Also write the result as JSON.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// The board's recording through the agent: in `top`, and beside the host's in one trace.
    Recorder {
        /// Also write the result as JSON.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// Prints flash and RAM of pong over executor and XRCE client, by part, and what each worker,
    /// subscription, publisher and budget takes.
    Size {
        /// Also write the result as JSON.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
}

impl Board {
    /// Checks the options before anything is built or run.
    ///
    /// # Errors
    /// An option that does not go with the experiment, or a file that cannot be written.
    pub(crate) fn check(&self) -> Outcome {
        match self {
            Self::Check => Ok(()),
            Self::Test { json, .. }
            | Self::Bench { json }
            | Self::Demo { json, .. }
            | Self::RoundTrip { json, .. }
            | Self::Recorder { json }
            | Self::Size { json } => writable(json.as_deref()),
            Self::Experiment(asked) => asked.check(),
        }
    }

    /// Runs the task.
    pub(crate) fn run(self) -> Outcome {
        match self {
            Self::Check => host::check().map(|()| println!("Nothing is missing.")),
            Self::Test { filter, json } => behaviour::run(filter.as_deref(), json.as_deref()),
            Self::Bench { json } => bench::run(json.as_deref()),
            Self::Demo { seconds, json } => demo::run(seconds, json.as_deref()),
            Self::RoundTrip { baud, json } => round_trip::run(&baud, json.as_deref()),
            Self::Recorder { json } => recorder::run(json.as_deref()),
            Self::Size { json } => size::run(json.as_deref()),
            Self::Experiment(asked) => {
                let json = asked.files.json.as_deref();
                match asked.name {
                    case::Name::Executor => executor::run(json),
                    case::Name::Restart => restart::run(asked.seconds(), json),
                    case::Name::Noise => noise::run(json),
                    name if asked.tasks => experiment::run(name, json),
                    name => messages::run(name, asked.seconds(), &asked.files),
                }
            }
        }
    }
}

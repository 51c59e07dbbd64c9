//! `cargo xtask board …`: builds the images of `firmware/`, runs them in QEMU and reports.
//!
//! - [`host`]: what the host must have, and the commands that would install it.
//! - [`qemu`]: builds an image and runs one case in the emulator.
//! - [`case`]: the cases of each experiment, and what theory expects of them.
//! - [`options`]: which options go with which experiment.
//! - [`experiment`]: runs them, compares, prints and writes.
//! - [`rig`], [`talk`], [`demo`]: the paper's test bench: the board runs pong, the host agent and ping.
//! - [`trip`]: round trips beside the time on the wire.
//! - [`noise`]: damaged bits on the line.
//! - [`restart`]: the agent is killed and started again.
//! - [`behaviour`]: runs the cases of the image `behaviour` like a test runner.
//! - [`executor`]: Experiment 1 on the executor itself.
//! - [`mod@bench`]: what switching and handing over cost, in instructions.
//! - [`print`](mod@print): printing to somebody who may stop reading.
//! - [`size`]: flash and static RAM of pong, by part; [`memory`]: what it takes of the heap.

// First: the others print with its macros.
#[macro_use]
#[path = "../../crates/replenish-cli/src/print.rs"]
mod print;

mod behaviour;
mod bench;
mod case;
mod demo;
mod executor;
mod experiment;
mod files;
mod host;
mod memory;
mod noise;
mod options;
mod qemu;
mod restart;
mod rig;
mod size;
mod talk;
mod trip;

use clap::{CommandFactory as _, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// What goes wrong is told in one text.
type Outcome<T = ()> = Result<T, String>;

#[derive(Parser)]
#[command(about = "Tasks of this repository")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// The emulated Olimex STM32-H405 board
    #[command(subcommand)]
    Board(Board),
}

#[derive(Subcommand)]
enum Board {
    /// Says what the host lacks, and how to install it; installs nothing
    Check,
    /// Runs the board's tests: locks, budgets, waits, policies, panics, heap and stacks
    Test {
        /// Only cases whose name contains this
        filter: Option<String>,
        /// Also write the result as JSON
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// Prints what a context switch, a hand-off and other basic steps take, in instructions
    Bench {
        /// Also write the result as JSON
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// The paper's test bench: the board runs pong, this machine agent and ping
    Demo {
        /// How long, in seconds of the board's time
        #[arg(long, value_name = "SECONDS", default_value_t = 10,
              value_parser = clap::value_parser!(u64).range(1..=60))]
        seconds: u64,
        /// Also write the result as JSON
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// Runs an experiment on the board; fails if a count is off
    Experiment(options::Asked),
    /// A message from the board to the host and back, beside the time of its bytes on the wire
    RoundTrip {
        /// The line's rates, in bits per second
        #[arg(long, value_name = "RATES", value_delimiter = ',', default_value = "115200,921600",
              value_parser = clap::value_parser!(u32).range(1_200..=4_000_000))]
        baud: Vec<u32>,
        /// Also write the result as JSON
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
    /// Prints flash and RAM of pong over executor and XRCE client, by part, and what each worker,
    /// subscription, publisher and budget takes
    Size {
        /// Also write the result as JSON
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
    },
}

fn main() -> ExitCode {
    let Task::Board(board) = Arguments::parse().task;
    if let Err(what) = board.check() {
        Arguments::command()
            .error(clap::error::ErrorKind::ArgumentConflict, what)
            .exit();
    }
    match board.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(what) => {
            eprintln!("{what}");
            ExitCode::FAILURE
        }
    }
}

impl Board {
    /// What can be said of the options before anything is built or run.
    fn check(&self) -> Outcome {
        match self {
            Self::Check => Ok(()),
            Self::Test { json, .. }
            | Self::Bench { json }
            | Self::Demo { json, .. }
            | Self::RoundTrip { json, .. }
            | Self::Size { json } => options::writable(json.as_deref()),
            Self::Experiment(asked) => asked.check(),
        }
    }

    fn run(self) -> Outcome {
        match self {
            Self::Check => host::check().map(|()| println!("Nothing is missing.")),
            Self::Test { filter, json } => behaviour::run(filter.as_deref(), json.as_deref()),
            Self::Bench { json } => bench::run(json.as_deref()),
            Self::Demo { seconds, json } => demo::run(seconds, json.as_deref()),
            Self::RoundTrip { baud, json } => trip::run(&baud, json.as_deref()),
            Self::Size { json } => size::run(json.as_deref()),
            Self::Experiment(asked) => {
                let json = asked.files.json.as_deref();
                match asked.name {
                    case::Name::Executor => executor::run(json),
                    case::Name::Restart => restart::run(asked.seconds(), json),
                    case::Name::Noise => noise::run(json),
                    name if asked.tasks => experiment::run(name, json),
                    name => talk::run(name, asked.seconds(), &asked.files),
                }
            }
        }
    }
}

/// Writes JSON where it was asked for.
fn write(path: Option<&std::path::Path>, value: &serde_json::Value) -> Outcome {
    let Some(path) = path else { return Ok(()) };
    std::fs::write(path, format!("{value:#}\n")).map_err(|e| format!("{}: {e}", path.display()))
}

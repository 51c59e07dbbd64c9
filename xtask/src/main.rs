//! Tasks of this repository: `cargo xtask board …`, `cargo xtask ci`, `cargo xtask circles`.
//!
//! - [`board`]: the emulated microcontroller, its tests, experiments and sizes.
//! - [`ci`]: the stages that must pass before anything lands.
//! - [`circles`]: files of a crate that import each other.
//! - [`output`]: outcomes and JSON files; [`print`](mod@print): printing to a pipe that may close.

// First: the others print with its macros.
#[macro_use]
#[allow(unreachable_pub, reason = "replenish-cli exports it")]
#[path = "../../crates/replenish-cli/src/print.rs"]
mod print;

mod board;
mod ci;
mod circles;
mod output;

use board::Board;
use clap::{CommandFactory as _, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Tasks of this repository")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// The emulated Olimex STM32-H405 board.
    #[command(subcommand)]
    Board(Board),
    /// Runs the stages of CI, all of them or those named; installs nothing.
    Ci {
        /// The stages to run, in this order.
        stages: Vec<ci::Stage>,
    },
    /// Lists files of a crate that import each other in a circle; fails if there are any.
    Circles {
        /// Crates to look at [default: every crate of this repository].
        crates: Vec<PathBuf>,
    },
}

fn main() -> ExitCode {
    let task = Arguments::parse().task;
    if let Task::Board(board) = &task
        && let Err(why) = board.check()
    {
        Arguments::command()
            .error(clap::error::ErrorKind::ArgumentConflict, why)
            .exit();
    }
    let outcome = match task {
        Task::Board(board) => board.run(),
        Task::Ci { stages } => ci::run(&stages),
        Task::Circles { crates } => circles::run(&crates),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

//! The `replenish` command: demo, experiments, the parts alone, doctor, benchmarks.

// First: the others print with its macros.
#[macro_use]
mod print;

mod commands;
mod load;
mod machine;
mod net;
mod options;
mod outcome;
mod parts;
mod report;
mod run;
mod signals;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match commands::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("replenish: {failure}");
            failure.exit_code()
        }
    }
}

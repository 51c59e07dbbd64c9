//! The whole `replenish` command: the laboratory's words beside those of a robot.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    replenish_cli::outcome::end(replenish_bench::Cli::parse().run())
}

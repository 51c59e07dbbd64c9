//! The `replenish` command of a robot. Words of the laboratory go to `replenish-bench`.

use clap::Parser;
use replenish_cli::{Command, laboratory, outcome};
use std::process::ExitCode;

/// A ROS executor that gives every callback a CPU budget: see it, measure it, run it.
#[derive(Debug, Parser)]
#[command(name = "replenish", version, arg_required_else_help = true)]
#[command(after_help = laboratory::HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

fn main() -> ExitCode {
    outcome::end(match laboratory::asked() {
        Some(program) => program.run(),
        None => Cli::parse().command.run(),
    })
}

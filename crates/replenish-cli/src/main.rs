//! The `replenish` command of a robot. Words of the laboratory go to `replenish-bench`.

use clap::Parser;
use replenish_cli::{Cli, laboratory, outcome};
use std::process::ExitCode;

fn main() -> ExitCode {
    outcome::end(match laboratory::asked() {
        Some(program) => program.run(),
        None => Cli::parse().run(),
    })
}

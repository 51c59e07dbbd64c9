//! The command line: the laboratory's words, and those of `replenish-cli`.

use crate::bench::{self, Bench};
use crate::experiment::{self, Experiment};
use crate::{demo, ping, pong};
use clap::{Parser, Subcommand};
use replenish_cli::outcome::Outcome;

/// A ROS executor that gives every callback a CPU budget: see it, measure it, run it.
#[derive(Debug, Parser)]
#[command(name = "replenish", version, arg_required_else_help = true)]
#[command(after_help = "Start with: replenish demo\n\
    Exit codes: 0 done, 1 could not be done (the reason is printed), 2 wrong command line.")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Two topics fight over one CPU; a budget decides. Ten seconds, then a table and a report.
    Demo(demo::Args),
    /// The experiments of the paper, with the theoretical line beside the measured one.
    #[command(subcommand)]
    Experiment(Experiment),
    #[command(flatten)]
    Robot(replenish_cli::Command),
    /// Figures of the mechanisms next to a baseline measured in the same run.
    #[command(subcommand)]
    Bench(Bench),
    /// Ping alone: sends on two topics and counts the answers.
    Ping(ping::Args),
    /// Pong alone: answers, its workers under their scheduling policies.
    Pong(pong::Args),
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// Why it did not do what was asked.
    pub fn run(self) -> Outcome {
        match self.command {
            Command::Demo(args) => demo::run(&args),
            Command::Experiment(which) => experiment::run(which),
            Command::Robot(word) => word.run(),
            Command::Bench(which) => bench::run(which),
            Command::Ping(args) => ping::run(&args),
            Command::Pong(args) => pong::run(&args),
        }
    }
}

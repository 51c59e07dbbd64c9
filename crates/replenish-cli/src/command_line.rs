//! The command line of `replenish`, and what is made of it: completions and manual pages.

use crate::commands::Command;
use crate::completions;
use crate::laboratory;
use crate::manual;
use crate::outcome::Outcome;
use crate::verbosity::Verbosity;
use clap::{CommandFactory, Parser, Subcommand};
use std::time::Instant;

/// A ROS executor that gives every callback a CPU budget: see it, measure it, run it.
#[derive(Debug, Parser)]
#[command(name = "replenish", version, arg_required_else_help = true)]
#[command(after_help = laboratory::HELP)]
pub struct Cli {
    #[command(subcommand)]
    word: Word,

    #[command(flatten)]
    verbosity: Verbosity,
}

#[derive(Debug, Subcommand)]
enum Word {
    #[command(flatten)]
    Robot(Command),
    /// Print the completions for a shell: `source <(replenish completions bash)`.
    Completions(completions::Args),
    /// Print the manual page; with --dir write one of each command.
    Man(manual::Args),
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// Why it did not do what was asked.
    pub fn run(self) -> Outcome {
        self.verbosity.apply();
        let began = Instant::now();
        let outcome = match self.word {
            Word::Robot(command) => command.run(),
            Word::Completions(args) => completions::run(&args, Self::command()),
            Word::Man(args) => manual::run(&args, Self::command()),
        };
        detail!("it took {:.1} s", began.elapsed().as_secs_f64());
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_do_not_contradict_each_other() {
        Cli::command().debug_assert();
    }
}

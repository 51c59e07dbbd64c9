//! Which stages run, in which order, and what runs beside what.

use super::run::{Beside, foreground};
use super::tally::Tally;
use crate::output::Outcome;
use std::time::Instant;

/// A part of CI that can be run alone.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Stage {
    /// Formatting, spelling, circles, lints of every workspace and feature set, documentation
    Lint,
    /// The README's test command, and the XRCE client as a microcontroller has it
    Test,
    /// Every interleaving of the concurrent protocols
    Loom,
    /// The emulated boards, `NuttX`, and what images take
    Board,
    /// Half a minute of fuzzing from the kept corpus
    Fuzz,
    /// Foreign implementations against ours
    Peers,
    /// Licences, sources and packages of the published crates
    Supply,
}

impl Stage {
    /// Its name on the command line.
    pub(super) fn word(self) -> String {
        let value = clap::ValueEnum::to_possible_value(&self);
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Runs the stages in the order given; all of them if none is.
///
/// # Errors
/// The first command that failed.
pub(crate) fn run(stages: &[Stage]) -> Outcome {
    let (began, mut tally) = (Instant::now(), Tally::default());
    let outcome = match stages {
        [] => all(&mut tally),
        stages => foreground(stages, &mut tally),
    };
    tally.print(began.elapsed());
    outcome
}

/// The emulated boards keep one CPU busy and their clock does not see the other, so that what has
/// no clock runs beside them. The tests have the machine to themselves.
fn all(tally: &mut Tally) -> Outcome {
    foreground(&[Stage::Lint], tally)?;
    let beside = Beside::start(&[Stage::Supply, Stage::Fuzz, Stage::Loom])?;
    foreground(&[Stage::Board], tally)?;
    beside.join(tally)?;
    foreground(&[Stage::Test, Stage::Peers], tally)
}

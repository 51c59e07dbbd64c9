//! The stages, their order, and the stages that run beside each other.

use super::run::{Beside, each, foreground};
use super::stage::Stage;
use super::stages::tests_with_peers;
use super::tally::Tally;
use crate::output::Outcome;
use std::time::Instant;

/// Runs the stages in the order given; if none is, all but `arch`, which is asked for by name.
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
    each(tests_with_peers(), tally)
}

//! The stages, their order, and the stages that run beside each other.

use super::run::{Beside, each, foreground};
use super::stage::Stage::{self, BuildPeers, Fuzz, LintOthers, Loom, Supply};
use super::stages::{lint_main, tests_with_peers};
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

/// Most commands keep less than two CPUs busy, so that two run side by side: the main workspace and
/// the emulated boards, whose clock does not see the other CPU, and all that builds in a folder of
/// its own. The tests have the machine to themselves.
fn all(tally: &mut Tally) -> Outcome {
    let others = [LintOthers, Loom, Fuzz, BuildPeers, Supply];
    let beside = Beside::start(&others)?;
    each(lint_main(), tally)?;
    foreground(&[Stage::Board], tally)?;
    beside.join(tally)?;
    each(tests_with_peers(), tally)
}

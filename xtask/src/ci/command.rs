//! The stages, their order, and the stages that run beside each other.

use super::run::{Beside, each, foreground};
use super::stage::Stage::{self, Board, BuildPeers, Installed, LintOthers, Loom, Package};
use super::stages::{lint_main, tests_with_peers};
use super::tally::Tally;
use crate::output::Outcome;
use std::time::Instant;

/// Runs the stages in the order given; if none is, all but those of the night: `arch`, `fuzz`,
/// `board-experiments`, `lint-foreign` and `supply` are asked for by name.
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
/// its own. The tests have the machine to themselves. The first commands need little of what
/// `.ci/install` brings, which may run meanwhile.
fn all(tally: &mut Tally) -> Outcome {
    let others = [Loom, Installed, LintOthers, BuildPeers, Package];
    let beside = Beside::start(&others)?;
    let here = each(lint_main(), tally).and_then(|()| foreground(&[Installed, Board], tally));
    // If this lane has failed, the other still runs to its end: one run tells the failures of both.
    both(here, beside.join(tally))?;
    each(tests_with_peers(), tally)
}

/// Succeeds if both do; otherwise every failure is told, one a line.
fn both(here: Outcome, beside: Outcome) -> Outcome {
    match (here, beside) {
        (Err(here), Err(beside)) => Err(format!("{here}\n{beside}")),
        (here, beside) => here.and(beside),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_of_both_lanes_are_told() {
        let (lint, fuzz) = (|| Err("lint".to_owned()), || Err("fuzz".to_owned()));
        assert_eq!(both(Ok(()), Ok(())), Ok(()));
        assert_eq!(both(lint(), Ok(())), lint());
        assert_eq!(both(Ok(()), fuzz()), fuzz());
        assert_eq!(both(lint(), fuzz()), Err("lint\nfuzz".to_owned()));
    }
}

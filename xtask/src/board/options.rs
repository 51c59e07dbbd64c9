//! The options of an experiment, checked together with its files before anything is built or run.
//! An option that means nothing to an experiment is refused, not ignored.

use super::case::{self, Name};
use super::files::Files;
use crate::output::Outcome;

/// Default length of each case, in seconds of the board's time.
const SECONDS: u64 = 10;

/// An experiment as it was asked for.
#[derive(clap::Args)]
pub(crate) struct Asked {
    /// The experiment's name.
    pub(crate) name: Name,
    /// Tasks that burn time, instead of executor and messages.
    #[arg(long)]
    pub(crate) tasks: bool,
    /// Length of each case, in seconds of the board's time [default: 10].
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=60))]
    seconds: Option<u64>,
    #[command(flatten)]
    pub(crate) files: Files,
}

impl Asked {
    /// The seconds of each case.
    pub(crate) fn seconds(&self) -> u64 {
        self.seconds.unwrap_or(SECONDS)
    }

    /// Refuses options that the experiment does not have, and files that cannot be written.
    pub(crate) fn check(&self) -> Outcome {
        let name = self.name;
        let refuse = |option: &str, why: &str| {
            let name = case::label(name);
            Err(format!("{option} does not go with {name}: {why}"))
        };
        if self.tasks && !has_tasks(name) {
            return refuse(
                "--tasks",
                "budget-sweep, odd-budgets, offsets and runaway have it",
            );
        }
        if self.seconds.is_some() && (self.tasks || !has_length(name)) {
            return refuse("--seconds", "its length is fixed (with --tasks: 10 s)");
        }
        if let (Some(option), true) = (self.files.drawn(), self.tasks || !case::is_drawn(name)) {
            return refuse(
                option,
                "budget-sweep and work-conserving have it, without --tasks",
            );
        }
        self.files.writable()
    }
}

/// Whether tasks that burn time can stand for executor and messages.
fn has_tasks(name: Name) -> bool {
    use Name::{BudgetSweep, OddBudgets, Offsets, Runaway};
    matches!(name, BudgetSweep | OddBudgets | Offsets | Runaway)
}

fn has_length(name: Name) -> bool {
    !matches!(name, Name::Executor | Name::Noise)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(tasks: bool, seconds: Option<u64>, csv: bool) -> impl Fn(Name) -> Outcome {
        move |name| {
            let files = Files {
                csv: csv.then(|| "/dev/null".into()),
                ..Files::default()
            };
            Asked {
                name,
                tasks,
                seconds,
                files,
            }
            .check()
        }
    }

    #[test]
    fn an_option_that_means_nothing_to_an_experiment_is_refused_by_name() {
        let refused = |done: Outcome, what: &[&str]| {
            let text = done.err().unwrap_or_default();
            assert!(what.iter().all(|w| text.contains(w)), "{text}");
        };
        // A flood of messages without messages would be no flood.
        for name in [
            Name::Flood,
            Name::WorkConserving,
            Name::Restart,
            Name::Noise,
        ] {
            refused(
                asked(true, None, false)(name),
                &["--tasks", &case::label(name)],
            );
        }
        refused(
            asked(false, Some(2), false)(Name::Executor),
            &["--seconds", "executor"],
        );
        refused(
            asked(true, Some(2), false)(Name::Offsets),
            &["--seconds", "offsets"],
        );
        refused(
            asked(false, None, true)(Name::OddBudgets),
            &["--csv", "odd-budgets"],
        );
        refused(
            asked(true, None, true)(Name::BudgetSweep),
            &["--csv", "budget-sweep"],
        );
    }

    #[test]
    fn what_an_experiment_has_is_taken() {
        assert_eq!(asked(false, Some(2), true)(Name::BudgetSweep), Ok(()));
        assert_eq!(asked(true, None, false)(Name::Offsets), Ok(()));
        assert_eq!(asked(false, None, false)(Name::Noise), Ok(()));
    }

    #[test]
    fn a_file_that_cannot_be_written_is_told_before_the_run() {
        let nowhere = std::path::Path::new("/nonexistent/sweep.json");
        let text = crate::output::writable(Some(nowhere))
            .err()
            .unwrap_or_default();
        assert!(text.contains("/nonexistent/sweep.json"), "{text}");
    }
}

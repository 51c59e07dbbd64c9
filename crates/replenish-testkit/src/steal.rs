//! Trials on a virtual machine: what failed while the hypervisor took CPU time away is no verdict.
//!
//! Tolerances stay as they are; the trial is repeated instead, and says so. Only the kernel's account of
//! stolen time decides about that, so on a machine that nobody takes anything from each trial runs once.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// What was stolen of a CPU: the product's own reader.
#[path = "../../replenish-os/src/linux/stolen.rs"]
pub mod stolen;

/// A trial runs so often at most.
const RUNS: u32 = 4;

/// With this much stolen from all CPUs, in ns, a failure is no verdict. The kernel tells it in steps of
/// 10 ms for each CPU.
const STOLEN: u64 = 20_000_000;

/// Time that was stolen from the CPUs since boot, in ns.
fn total() -> u64 {
    (0..).map_while(stolen::stolen).sum()
}

/// Whether a failed run is repeated: there is one left, and so much was `taken` meanwhile.
fn is_repeated(runs_left: u32, taken: u64) -> bool {
    runs_left > 0 && taken >= STOLEN
}

/// Runs `body`; again, at most three times, if it panicked while 20 ms or more were stolen.
///
/// # Panics
/// As `body` does when it does so undisturbed, or in the last run.
pub fn undisturbed(name: &str, body: &dyn Fn()) {
    watched(name, &total, body);
}

fn watched(name: &str, taken_so_far: &dyn Fn() -> u64, body: &dyn Fn()) {
    for left in (0..RUNS).rev() {
        let before = taken_so_far();
        let Err(panic) = catch_unwind(AssertUnwindSafe(body)) else {
            return;
        };
        let taken = taken_so_far().saturating_sub(before);
        if !is_repeated(left, taken) {
            resume_unwind(panic);
        }
        let ms = taken / 1_000_000;
        eprintln!("repeated: {name}: it failed while the hypervisor took {ms} ms of CPU time");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// How often a body runs that always panics while so much is stolen each time, in ns.
    fn runs(stolen: u64) -> u32 {
        let (runs, clock) = (Cell::new(0), Cell::new(0));
        let body = || {
            runs.set(runs.get() + 1);
            clock.set(clock.get() + stolen);
            assert_eq!(1, 2, "always");
        };
        let all = || watched("test", &|| clock.get(), &body);
        assert!(catch_unwind(AssertUnwindSafe(all)).is_err());
        runs.get()
    }

    #[test]
    fn a_failure_counts_at_once_unless_time_was_stolen_and_then_after_four_runs() {
        assert_eq!(runs(0), 1);
        assert_eq!(runs(STOLEN - 1), 1);
        assert_eq!(runs(STOLEN), 4);
    }

    #[test]
    fn what_passes_is_not_repeated() {
        let runs = Cell::new(0);
        let body = || {
            runs.set(runs.get() + 1);
            assert_eq!(runs.get(), 2, "the first run fails");
        };
        let clock = Cell::new(0);
        let steals = || clock.replace(clock.get() + STOLEN);
        watched("test", &steals, &body);
        watched("test", &steals, &|| ());
        assert_eq!(runs.get(), 2);
    }
}

//! Trials on a machine that did not do its part: what failed meanwhile is no verdict.
//!
//! Tolerances stay as they are; the trial is repeated instead, and says so. Clocks alone decide
//! about that, so on a machine that nobody takes anything from each trial runs once.
//!
//! | | for trials at | what decides |
//! |---|---|---|
//! | [`undisturbed`] | real-time priority | the kernel's account of time that the hypervisor stole |
//! | [`unstalled`] | ordinary priority, with limits in wall time | how late a thread woke that only sleeps |

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// What was stolen of a CPU: the product's own reader.
#[path = "../../replenish-os/src/linux/steal_time.rs"]
pub mod steal_time;

/// A trial runs so often at most.
const RUNS: u32 = 4;

/// With this much stolen from all CPUs, in ns, a failure is no verdict. The kernel tells it in
/// steps of 10 ms for each CPU.
const STOLEN: u64 = 20_000_000;

/// Time that was stolen from the CPUs since boot, in ns.
fn total() -> u64 {
    (0..).map_while(steal_time::steal_time).sum()
}

/// A hypervisor takes CPU time for seconds on end: so long is waited for it to stop before the next
/// run.
const PATIENCE: Duration = Duration::from_secs(60);

/// Waits until nothing is stolen, up to a minute. Only who runs can see that.
fn calm() {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        let (before, begun) = (total(), Instant::now());
        while begun.elapsed() < Duration::from_millis(500) {
            std::hint::spin_loop();
        }
        if total().saturating_sub(before) < STOLEN {
            return;
        }
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// A thread that only sleeps wakes so much later than asked, at worst, on a machine that keeps up,
/// in ns.
const LATE: u64 = 50_000_000;

/// Runs `body`; again, at most three times and when that seems to be over, if it panicked while 20
/// ms or more were stolen.
///
/// # Panics
/// As `body` does when it does so undisturbed, or in the last run.
pub fn undisturbed(name: &str, body: &dyn Fn()) {
    let what = "the hypervisor took CPU time:";
    watched(name, what, (STOLEN, &total), &calm, body);
}

/// Runs `body`; again, at most three times, if it panicked while an ordinary thread did not get to
/// run for 50 ms or more.
///
/// # Panics
/// As `body` does when the machine kept up, or in the last run.
pub fn unstalled(name: &str, body: &dyn Fn()) {
    let probe = Probe::start();
    let so_far = || probe.0.late.load(Ordering::Relaxed);
    let what = "ordinary threads had to wait:";
    watched(name, what, (LATE, &so_far), &|| (), body);
}

/// A thread that only sleeps, until this is dropped.
struct Probe(Arc<Shared>);

#[derive(Default)]
struct Shared {
    /// The sum of what was late, in ns.
    late: AtomicU64,
    over: AtomicBool,
}

impl Probe {
    fn start() -> Self {
        const NAP: Duration = Duration::from_millis(10);
        let shared = Arc::<Shared>::default();
        let theirs = Arc::clone(&shared);
        std::thread::spawn(move || {
            crate::alloc::exempt_this_thread();
            while !theirs.over.load(Ordering::Relaxed) {
                let due = Instant::now() + NAP;
                std::thread::sleep(NAP);
                let late = u64::try_from(due.elapsed().as_nanos()).unwrap_or(u64::MAX);
                if late >= LATE {
                    theirs.late.fetch_add(late, Ordering::Relaxed);
                }
            }
        });
        Self(shared)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        self.0.over.store(true, Ordering::Relaxed);
    }
}

/// `rest`: what is waited for before the next run.
fn watched(
    name: &str,
    what: &str,
    (limit, taken_so_far): (u64, &dyn Fn() -> u64),
    rest: &dyn Fn(),
    body: &dyn Fn(),
) {
    for left in (0..RUNS).rev() {
        let before = taken_so_far();
        let Err(panic) = catch_unwind(AssertUnwindSafe(body)) else {
            return;
        };
        let taken = taken_so_far().saturating_sub(before);
        if left == 0 || taken < limit {
            resume_unwind(panic);
        }
        let ms = taken / 1_000_000;
        eprintln!("repeated: {name}: it failed while {what} {ms} ms");
        rest();
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
        let rests = Cell::new(0);
        let rest = || rests.set(rests.get() + 1);
        let all = || watched("test", "we took", (STOLEN, &|| clock.get()), &rest, &body);
        assert!(catch_unwind(AssertUnwindSafe(all)).is_err());
        assert_eq!(rests.get() + 1, runs.get(), "before each further run");
        runs.get()
    }

    #[test]
    fn a_failure_counts_at_once_unless_time_was_stolen_and_then_after_four_runs() {
        assert_eq!(runs(0), 1);
        assert_eq!(runs(STOLEN - 1), 1);
        assert_eq!(runs(STOLEN), 4);
    }

    #[test]
    fn a_machine_that_keeps_up_is_given_no_second_run() {
        let runs = Cell::new(0);
        let all = || {
            unstalled("test", &|| {
                runs.set(runs.get() + 1);
                assert_eq!(runs.get(), 2, "the first run fails");
            });
        };
        // Whether it keeps up, this test cannot know; but it is one or the other.
        let failed = catch_unwind(AssertUnwindSafe(all)).is_err();
        assert_eq!(runs.get(), if failed { 1 } else { 2 });
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
        watched("test", "we took", (STOLEN, &steals), &|| (), &body);
        watched("test", "we took", (STOLEN, &steals), &|| (), &|| ());
        assert_eq!(runs.get(), 2);
    }
}

//! Trials on a machine that did not do its part: what failed meanwhile is no verdict.
//!
//! Tolerances stay as they are; the trial is repeated instead, and says so. A failure that no clock
//! explains gets one second chance, in which the trial must pass twice. A fault that shows in half
//! of all runs still fails three of four trials that met it. A fault that shows in every run fails
//! in the end, whatever the machine does.
//!
//! | | for trials at | what decides | runs |
//! |---|---|---|---|
//! | [`undisturbed`] | real-time priority | the kernel's account of time that the hypervisor stole | 8 |
//! | | | how late threads at FIFO 99 woke that only sleep ([`Witness`]) | 8 |
//! | [`unstalled`] | ordinary priority, with limits in wall time | how late a thread woke that only sleeps | 4 |

use crate::skip::Skipped;
use crate::witness::Witness;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The product's own reader of steal time.
#[path = "../../replenish-os/src/linux/steal_time.rs"]
pub mod steal_time;

/// With this much stolen from all CPUs, in ns, a failure is no verdict. The kernel tells it in
/// steps of 10 ms for each CPU.
const STOLEN: u64 = 20_000_000;

/// Time that was stolen from the CPUs since boot, in ns.
fn total() -> u64 {
    (0..).map_while(steal_time::steal_time).sum()
}

/// With this much lateness of threads at FIFO 99, in ns, a failure is no verdict.
const STANDSTILL: u64 = 5_000_000;

/// The longest wait before the next run for the hypervisor to stop taking CPU time, which it may do
/// for seconds on end.
const PATIENCE: Duration = Duration::from_secs(60);

/// Waits until nothing is stolen and nothing stands still, up to a minute. Only a thread that runs
/// can see a theft.
fn calm(witness: &Witness) {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        let (stolen, still, begun) = (total(), witness.settled(), Instant::now());
        while begun.elapsed() < Duration::from_millis(500) {
            std::hint::spin_loop();
        }
        if total().saturating_sub(stolen) < STOLEN
            && witness.settled().saturating_sub(still) < STANDSTILL
        {
            return;
        }
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// The worst lateness in ns of a thread that only sleeps, on a machine that keeps up.
const LATE: u64 = 50_000_000;

/// A disturbance by the machine that may excuse a failure, as measured so far.
struct Disturbance<'a> {
    /// The clause that names it in the log.
    said: &'static str,
    /// A failure during which there was less of it counts, in ns.
    limit: u64,
    so_far: &'a dyn Fn() -> u64,
}

/// Runs `body`, at most eight times, until it passes.
///
/// It runs again, after the disturbance, if it panicked while 20 ms or more were stolen or threads
/// at FIFO 99 woke 5 ms too late; and once more twice after a panic that no clock explains.
///
/// # Panics
/// As `body` does when it does so undisturbed for the second time, or in the last run.
pub fn undisturbed(name: &str, body: &dyn Fn()) {
    let witness = Witness::start();
    let stolen = Disturbance {
        said: "the hypervisor took CPU time:",
        limit: STOLEN,
        so_far: &total,
    };
    let still = Disturbance {
        said: "threads at FIFO 99 had to wait, which no account explains:",
        limit: STANDSTILL,
        so_far: &|| witness.settled(),
    };
    watched(name, 8, &[stolen, still], &|| calm(&witness), body);
}

/// Runs `body`; again, at most three times, if it panicked while an ordinary thread did not get to
/// run for 50 ms or more, and once more twice after a panic that no clock explains.
///
/// # Panics
/// As `body` does when the machine kept up for the second time, or in the last run.
pub fn unstalled(name: &str, body: &dyn Fn()) {
    let probe = Probe::start();
    let so_far = || probe.0.late.load(Ordering::Relaxed);
    let waited = Disturbance {
        said: "ordinary threads had to wait:",
        limit: LATE,
        so_far: &so_far,
    };
    watched(name, 4, &[waited], &|| (), body);
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

/// Runs `body` `runs` times at most. `rest`: what is waited for before the next run.
fn watched(
    name: &str,
    runs: u32,
    disturbances: &[Disturbance<'_>],
    rest: &dyn Fn(),
    body: &dyn Fn(),
) {
    let so_far = || disturbances.iter().map(|d| (d.so_far)());
    let (mut run, mut unexplained, mut passes) = (1, false, 1);
    while passes > 0 {
        let before: Vec<u64> = so_far().collect();
        let Err(panic) = catch_unwind(AssertUnwindSafe(body)) else {
            passes -= 1;
            continue;
        };
        if panic.is::<Skipped>() {
            resume_unwind(panic);
        }
        let taken = so_far()
            .zip(before)
            .map(|(now, then)| now.saturating_sub(then));
        let cause = disturbances
            .iter()
            .zip(taken)
            .find(|(d, taken)| *taken >= d.limit);
        if run == runs || (cause.is_none() && unexplained) {
            resume_unwind(panic);
        }
        run += 1;
        if let Some((disturbance, taken)) = cause {
            let (said, ms) = (disturbance.said, taken / 1_000_000);
            eprintln!("repeated: {name}: it failed while {said} {ms} ms");
        } else {
            unexplained = true;
            passes = 2;
            eprintln!("unsteady: {name}: no clock tells why it failed; it must pass twice now");
        }
        rest();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// Number of runs of a body that panics in the runs that `fails` names, and whether the end is
    /// a failure. In each run the hypervisor takes `stolen` ns, and the machine stands still for
    /// `still` ns.
    fn runs((stolen, still): (u64, u64), fails: fn(u32) -> bool) -> (u32, bool) {
        let runs = Cell::new(0);
        let body = || {
            runs.set(runs.get() + 1);
            assert!(!fails(runs.get()), "as asked");
        };
        let taken = || u64::from(runs.get()) * stolen;
        let stood = || u64::from(runs.get()) * still;
        let each = [(STOLEN, &taken as &dyn Fn() -> u64), (STANDSTILL, &stood)];
        let clocks = each.map(|(limit, so_far)| Disturbance {
            said: "we took",
            limit,
            so_far,
        });
        let all = || watched("test", 8, &clocks, &|| (), &body);
        let failed = catch_unwind(AssertUnwindSafe(all)).is_err();
        (runs.get(), failed)
    }

    #[test]
    fn a_failure_counts_the_second_time_unless_it_was_disturbed_and_then_after_eight_runs() {
        assert_eq!(runs((0, 0), |_| true), (2, true));
        assert_eq!(runs((STOLEN - 1, STANDSTILL - 1), |_| true), (2, true));
        assert_eq!(runs((STOLEN, 0), |_| true), (8, true));
        assert_eq!(runs((0, STANDSTILL), |_| true), (8, true));
    }

    #[test]
    fn after_a_failure_that_nothing_explains_two_runs_must_pass() {
        assert_eq!(runs((0, 0), |run| run == 1), (3, false));
        assert_eq!(runs((0, 0), |run| run != 2), (3, true));
        assert_eq!(runs((STOLEN, 0), |run| run == 1), (2, false));
        assert_eq!(runs((0, STANDSTILL), |run| run < 8), (8, false));
    }

    #[test]
    fn what_passes_is_not_repeated() {
        assert_eq!(runs((STOLEN, STANDSTILL), |_| false), (1, false));
    }

    /// The real clocks: a body that fails while a thread at FIFO 99 has the CPU runs again.
    #[test]
    fn a_real_standstill_is_a_disturbance() {
        if let Err(why) = crate::rt::available() {
            assert!(!crate::rt::required(), "{why}");
            eprintln!("skipped: {why}");
            return;
        }
        let _alone = crate::rt::lock().unwrap();
        let runs = Cell::new(0);
        let body = || {
            runs.set(runs.get() + 1);
            let still = std::thread::spawn(|| {
                // The kernel would move it out of the way of a thread that is pinned.
                let cpu = crate::rt::cpus()[0];
                crate::rt::fifo(99)
                    .and_then(|()| crate::rt::pin(cpu))
                    .unwrap();
                let end = Instant::now() + Duration::from_millis(30);
                while Instant::now() < end {}
            });
            still.join().unwrap();
            assert!(runs.get() > 3, "not before the fourth run");
        };
        undisturbed("test", &body);
        assert_eq!(runs.get(), 4);
    }
}

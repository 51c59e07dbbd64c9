//! A witness of standstills: one thread on each CPU, above all others, that only sleeps and sees
//! how late it wakes.
//!
//! A virtual machine also stands still without an account of it: no thread runs, the kernel's steal
//! time stays as it is, and afterwards everything is late. A thread at FIFO 99 wakes within
//! microseconds on a machine that keeps up; its lateness is the time for which its CPU ran nothing,
//! or another thread of that priority.
//!
//! A wake-up costs 8 to 20 us on a loaded virtual machine: 0.2 to 0.4 % of each CPU with naps of
//! 5 ms. The threads do not count as allocating ([`crate::alloc`]).

use crate::{alloc, rt};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The nap of [`Witness::start`].
const NAP: Duration = Duration::from_millis(5);

/// Lateness in ns that shows a standstill.
const LATE: u64 = 2_000_000;

/// A thread of FIFO 99 may run instead of the witness: its answer is not waited for any longer.
const PATIENCE: Duration = Duration::from_secs(1);

/// Sums how long the machine stood still, until it is dropped.
pub struct Witness {
    seen: Arc<Seen>,
    threads: Vec<JoinHandle<()>>,
}

struct Seen {
    begun: Instant,
    /// The sum of all lateness, in ns.
    late: AtomicU64,
    /// The end of the last standstill, in ns since `begun`; 0 before the first.
    last: AtomicU64,
    /// The naps of each CPU's thread.
    naps: Vec<AtomicU64>,
    over: AtomicBool,
}

impl Witness {
    /// Watches the CPUs that the calling thread may use, with naps of 5 ms.
    #[must_use]
    pub fn start() -> Self {
        Self::napping(NAP)
    }

    /// Watches with naps of this length. A standstill that falls between two wake-ups is not seen.
    #[must_use]
    pub fn napping(nap: Duration) -> Self {
        let cpus = rt::cpus();
        let seen = Arc::new(Seen {
            begun: Instant::now(),
            late: AtomicU64::new(0),
            last: AtomicU64::new(0),
            naps: cpus.iter().map(|_| AtomicU64::new(0)).collect(),
            over: AtomicBool::new(false),
        });
        let start = |(nth, cpu)| {
            let seen = Arc::clone(&seen);
            let thread = std::thread::Builder::new().name(format!("witness/{cpu}"));
            thread.spawn(move || {
                alloc::exempt_this_thread();
                // Priority first: an ordinary thread might never run where it is pinned.
                if rt::fifo(99).and_then(|()| rt::pin(cpu)).is_ok() {
                    seen.watch(nth, nap);
                }
            })
        };
        let threads = cpus.into_iter().enumerate().flat_map(start).collect();
        Self { seen, threads }
    }

    /// Time in ns that the CPUs stood still so far, all of them together.
    #[must_use]
    pub fn so_far(&self) -> u64 {
        self.seen.late.load(Ordering::SeqCst)
    }

    /// Like [`so_far`](Self::so_far), with a standstill that has only just ended: waits until every
    /// thread has woken once more.
    #[must_use]
    pub fn settled(&self) -> u64 {
        let naps = || self.seen.naps.iter().map(|n| n.load(Ordering::SeqCst));
        let (before, end): (Vec<u64>, _) = (naps().collect(), Instant::now() + PATIENCE);
        let waiting = || naps().zip(&before).any(|(now, before)| now <= *before);
        while waiting() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.so_far()
    }

    /// Whether a standstill ended within this time before now.
    #[must_use]
    pub fn saw_one_within(&self, age: Duration) -> bool {
        let last = self.seen.last.load(Ordering::SeqCst);
        last > 0 && self.seen.since_begun().saturating_sub(last) <= nanos(age)
    }
}

impl Drop for Witness {
    fn drop(&mut self) {
        self.seen.over.store(true, Ordering::SeqCst);
        for thread in self.threads.drain(..) {
            thread.join().ok();
        }
    }
}

impl Seen {
    fn watch(&self, nth: usize, nap: Duration) {
        while !self.over.load(Ordering::SeqCst) {
            let due = Instant::now() + nap;
            std::thread::sleep(nap);
            let late = nanos(due.elapsed());
            if late >= LATE {
                self.last.fetch_max(self.since_begun(), Ordering::SeqCst);
                self.late.fetch_add(late, Ordering::SeqCst);
            }
            if let Some(naps) = self.naps.get(nth) {
                naps.fetch_add(1, Ordering::SeqCst);
            }
        }
    }

    fn since_begun(&self) -> u64 {
        nanos(self.begun.elapsed())
    }
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Another thread at FIFO 99 has a CPU for 20 ms: to the witness that is a standstill.
    #[test]
    fn a_cpu_that_runs_nothing_else_is_seen_and_a_sleep_is_not() {
        if let Err(why) = rt::available() {
            assert!(!rt::required(), "{why}");
            eprintln!("skipped: {why}");
            return;
        }
        let _alone = rt::lock().unwrap();
        let witness = Witness::napping(MS);
        let cpu = rt::cpus()[0];
        let before = witness.settled();
        let hog = std::thread::spawn(move || {
            rt::fifo(99).and_then(|()| rt::pin(cpu)).unwrap();
            let end = Instant::now() + 20 * MS;
            while Instant::now() < end {}
        });
        hog.join().unwrap();
        let seen = witness.settled() - before;
        assert!(seen >= 15_000_000, "{seen} of 20 ms");
        assert!(witness.saw_one_within(Duration::from_secs(3600)));
        // The machine may stand still at any time, but not each time.
        let calm = || {
            let before = witness.settled();
            std::thread::sleep(20 * MS);
            witness.settled() == before && !witness.saw_one_within(10 * MS)
        };
        assert!((0..500).any(|_| calm()), "every sleep counts");
    }
}

//! The least that waking several threads costs: each waits on a futex of its own, notes when it
//! runs, and waits again. Nothing of the library is in between.
//!
//! ```text
//!   publisher's thread ── wake 1 ─ wake 2 ─ wake 3 ──► threads above it, on the same CPU
//! ```

use crate::load::Nanos;
use crate::load::spec::HIGH_PRIORITY;
use replenish_cli::machine::fifo_or_other;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::baseline::BareFutex;
use replenish_os::{Thread, ThreadSpec, clock, spawn};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

/// When the last thread has run, and how many have.
#[derive(Default)]
struct Seen {
    begun: AtomicUsize,
    last_start: AtomicU64,
    ends: AtomicBool,
}

/// Threads that wait to be woken.
pub(crate) struct WakeFloor {
    seen: Arc<Seen>,
    threads: Vec<(Arc<BareFutex>, Thread<()>)>,
}

impl WakeFloor {
    /// Starts so many threads, with the policy and the CPU of the benchmark's workers.
    pub(crate) fn start(threads: usize, cpu: usize) -> Result<Self, Failure> {
        let seen = Arc::new(Seen::default());
        let start = |number| {
            let word = Arc::new(BareFutex::new());
            let (own, seen) = (Arc::clone(&word), Arc::clone(&seen));
            let body = move || {
                loop {
                    own.wait();
                    seen.last_start
                        .fetch_max(clock::monotonic(), Ordering::Relaxed);
                    seen.begun.fetch_add(1, Ordering::Release);
                    if seen.ends.load(Ordering::Acquire) {
                        return;
                    }
                }
            };
            let spec = ThreadSpec::new(format!("floor{number}"))
                .policy(fifo_or_other(HIGH_PRIORITY))
                .cpu(cpu);
            let thread = spawn(spec, body).map_err(Failure::refused)?;
            Ok::<_, Failure>((word, thread))
        };
        let threads = (0..threads).map(start).collect::<Result<_, _>>()?;
        Ok(Self { seen, threads })
    }

    /// Wakes them one after another: the time until the last one runs, and the CPU time of the
    /// caller.
    pub(crate) fn wake(&self) -> Result<(Nanos, Nanos), Failure> {
        self.seen.begun.store(0, Ordering::Relaxed);
        self.seen.last_start.store(0, Ordering::Relaxed);
        let cpu = clock::thread_cpu();
        let began = clock::monotonic();
        self.threads.iter().for_each(|(word, _)| word.set());
        let cpu = clock::thread_cpu().saturating_sub(cpu);
        let limit = began + 1_000_000_000;
        while self.seen.begun.load(Ordering::Acquire) < self.threads.len() {
            let now = clock::monotonic();
            if now > limit {
                return Err(Failure::refused("a thread of the floor does not run"));
            }
            clock::sleep_until(now + 50_000);
        }
        let last = self.seen.last_start.load(Ordering::Relaxed);
        Ok((last.saturating_sub(began), cpu))
    }

    /// Ends the threads.
    pub(crate) fn stop(self) -> Outcome {
        self.seen.ends.store(true, Ordering::Release);
        for (word, thread) in self.threads {
            word.set();
            let ended = thread.join();
            ended.map_err(|_| Failure::refused("a thread of the floor panicked"))?;
        }
        Ok(())
    }
}

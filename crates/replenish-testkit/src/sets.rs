//! Properties over random sets, by seed, on all CPUs.
//!
//! `REPLENISH_SETS` says how many sets, `REPLENISH_SEED` the first seed; a failure names its seed,
//! and
//! `REPLENISH_SEED=that REPLENISH_SETS=1` plays it again.

use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Instant;

/// Seeds that a thread takes at a time.
const BLOCK: u64 = 64;
/// Number of sets between two lines of progress.
const LINE: u64 = 100_000;

/// Number of sets: `REPLENISH_SETS`, or `default`.
#[must_use]
pub fn wanted(default: u64) -> u64 {
    from_env("REPLENISH_SETS").unwrap_or(default)
}

fn from_env(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

/// Calls `check` with each of `sets` seeds, from `REPLENISH_SEED` (or 0) on, on as many threads as
/// there are CPUs, and returns what each thread has tallied.
///
/// # Panics
/// If `check` does, on any thread.
pub fn each<T: Default + Send>(sets: u64, check: impl Fn(u64, &mut T) + Sync) -> Vec<T> {
    let first = from_env("REPLENISH_SEED").unwrap_or(0);
    let next = AtomicU64::new(0);
    let start = Instant::now();
    let work = || {
        let mut tally = T::default();
        loop {
            let from = next.fetch_add(BLOCK, Ordering::Relaxed);
            if from >= sets {
                return tally;
            }
            for index in from..sets.min(from + BLOCK) {
                check(first + index, &mut tally);
                if (index + 1).is_multiple_of(LINE) {
                    let seconds = start.elapsed().as_secs();
                    eprintln!("{} of {sets} sets after {seconds} s", index + 1);
                }
            }
        }
    };
    let threads = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let ended = running.into_iter().map(thread::ScopedJoinHandle::join);
        // Joined by hand, so that the panic of one is passed on as it was.
        ended
            .map(|end| end.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_seed_comes_once() {
        let tallies: Vec<Vec<u64>> = each(200, |seed, tally: &mut Vec<u64>| tally.push(seed));
        let mut seeds: Vec<u64> = tallies.into_iter().flatten().collect();
        seeds.sort_unstable();
        let first = from_env("REPLENISH_SEED").unwrap_or(0);
        assert_eq!(seeds, (first..first + 200).collect::<Vec<_>>());
    }
}

//! The cost of waking a thread: a caller and threads that answer it, all on one CPU.
//!
//! ```text
//!   caller (98) ── there.set() ──► echo (97): the time at which it woke
//!               ◄── back.set() ───
//! ```
//!
//! They are FIFO threads, as dispatcher and worker are. Several ways of waking take turns in
//! blocks, so that all see the same machine.

use crate::machine::{self, stats::Sorted};
use crate::outcome::Failure;
use crate::time::{Nanos, SEC};
use replenish_os::{Notify, Policy, ThreadSpec, clock, current_tid, granted, spawn};
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Round trips per block.
pub const BLOCK: usize = 500;

/// Blocks for an estimate: some thousand round trips.
const ESTIMATE: usize = 6;

/// A means of waking a thread: one waiter, one value.
pub trait Cell: Send + Sync + 'static {
    /// Wakes the waiter.
    fn set(&self);
    /// Waits for a wake-up, and takes it.
    fn wait(&self);
}

impl Cell for Notify {
    fn set(&self) {
        Notify::set(self);
    }

    fn wait(&self) {
        Notify::wait(self);
    }
}

/// Two cells, there and back, and the time at which the far side woke.
struct Pair<C> {
    there: C,
    back: C,
    woke: AtomicU64,
    done: AtomicBool,
}

/// Samples of one way of waking, in nanoseconds, as they come.
#[derive(Debug, Default)]
struct Times {
    one_way: Vec<i64>,
    round_trip: Vec<i64>,
}

/// Samples of one way of waking, in nanoseconds.
#[derive(Debug)]
pub struct Samples {
    /// Time from the signal to the thread that it wakes.
    pub one_way: Sorted,
    /// There and back.
    pub round_trip: Sorted,
}

/// A thread that answers, by one way of waking.
pub struct Echo {
    block: Box<dyn Fn(&mut Times) + Send>,
    end: Box<dyn FnOnce() -> Result<(), Failure> + Send>,
}

impl Echo {
    /// Starts it on `cpu`; the caller wakes it through `there` and waits for `back`.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start<C: Cell>(name: &str, cpu: usize, there: C, back: C) -> Result<Self, Failure> {
        let pair = Arc::new(Pair {
            there,
            back,
            woke: AtomicU64::new(0),
            done: AtomicBool::new(false),
        });
        let far = Arc::clone(&pair);
        let worker = spawn(thread(name, cpu, 97), move || answer(&far)).map_err(|e| failed(&e))?;
        let near = Arc::clone(&pair);
        Ok(Self {
            block: Box::new(move |times| block(&near, times)),
            end: Box::new(move || {
                pair.done.store(true, Ordering::Release);
                pair.there.set();
                worker.join().map_err(|_| failed(&"a thread panicked"))
            }),
        })
    }
}

/// `blocks` blocks with each of `echoes` in turn; their samples and the granted policy.
///
/// # Errors
/// A thread cannot be started, or panicked.
pub fn measure<const N: usize>(
    cpu: usize,
    blocks: usize,
    echoes: [Echo; N],
) -> Result<([Samples; N], String), Failure> {
    let caller = move || {
        let mut times = [(); N].map(|()| Times {
            one_way: Vec::with_capacity(blocks * BLOCK),
            round_trip: Vec::with_capacity(blocks * BLOCK),
        });
        for _ in 0..blocks {
            for (echo, times) in echoes.iter().zip(&mut times) {
                (echo.block)(times);
            }
            // Keeps far from the RT throttle, whatever the number of samples.
            clock::sleep_until(clock::monotonic() + SEC / 1_000);
        }
        let granted = granted(current_tid()).map(|g| g.to_string());
        (echoes, times, granted)
    };
    let (echoes, times, granted) = spawn(thread("caller", cpu, 98), caller)
        .map_err(|e| failed(&e))?
        .join()
        .map_err(|_| failed(&"a thread panicked"))?;
    for echo in echoes {
        (echo.end)()?;
    }
    let samples = times.map(|times| Samples {
        one_way: Sorted::new(times.one_way),
        round_trip: Sorted::new(times.round_trip),
    });
    Ok((samples, granted.map_err(|e| failed(&e))?))
}

/// The 99th percentiles of a signal's way to the thread that it wakes, and of there and back, on
/// `cpu`, in ns.
///
/// # Errors
/// As of [`measure`].
pub fn estimate(cpu: usize) -> Result<(Nanos, Nanos), Failure> {
    let echo = Echo::start("echo/signal", cpu, Notify::new(), Notify::new())?;
    let ([signal], _) = measure(cpu, ESTIMATE, [echo])?;
    let ns = |sorted: &Sorted| Nanos::try_from(sorted.percentile(99)).unwrap_or(0);
    Ok((ns(&signal.one_way), ns(&signal.round_trip)))
}

/// FIFO if it is granted, else the best there is.
fn thread(name: &str, cpu: usize, priority: u8) -> ThreadSpec {
    let policy: Policy = machine::fifo_or_other(priority);
    ThreadSpec::new(name).policy(policy).cpu(cpu)
}

fn failed(e: &dyn Display) -> Failure {
    Failure::refused(format!("hand-off: {e}"))
}

/// The far side.
fn answer<C: Cell>(pair: &Pair<C>) {
    loop {
        pair.there.wait();
        if pair.done.load(Ordering::Acquire) {
            return;
        }
        pair.woke.store(clock::monotonic(), Ordering::Release);
        pair.back.set();
    }
}

/// One block of round trips.
fn block<C: Cell>(pair: &Pair<C>, times: &mut Times) {
    for _ in 0..BLOCK {
        let sent = clock::monotonic();
        pair.there.set();
        pair.back.wait();
        let back = clock::monotonic();
        let ns = |t: Nanos| i64::try_from(t.saturating_sub(sent)).unwrap_or(i64::MAX);
        times.one_way.push(ns(pair.woke.load(Ordering::Acquire)));
        times.round_trip.push(ns(back));
    }
}

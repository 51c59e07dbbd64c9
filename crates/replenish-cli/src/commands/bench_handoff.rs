//! `replenish bench handoff`: waking a worker through `replenish_os::Signal`, against a bare futex.
//!
//! Two FIFO threads on one CPU, as dispatcher and worker are: the upper one signals the lower one
//! and waits for its answer. Both primitives take turns in blocks, so that both see the same
//! machine.

use crate::load::{Nanos, SEC};
use crate::machine;
use crate::machine::cpus::{self, Cpus};
use crate::machine::stats::Sorted;
use crate::options::JsonOption;
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::report::table::Table;
use crate::run::lock;
use replenish_os::baseline::BareFutex;
use replenish_os::{Policy, Signal, ThreadSpec, clock, current_tid, granted, spawn};
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Round trips per block; the blocks of both primitives alternate.
const BLOCK: usize = 500;

/// Options of `bench handoff`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Round trips per primitive
    #[arg(long, value_name = "N", default_value_t = 20_000,
          value_parser = clap::value_parser!(u64).range(1_000..=1_000_000))]
    samples: u64,

    /// The CPU of both threads
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    #[command(flatten)]
    json: JsonOption,
}

/// Median and 99th percentile in nanoseconds.
#[derive(Debug, Clone, Copy, serde::Serialize)]
struct Times {
    median: i64,
    p99: i64,
}

/// `bench handoff --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Json {
    one_way_ns: Times,
    round_trip_ns: Times,
    futex_one_way_ns: Times,
    futex_round_trip_ns: Times,
    ratio_one_way: f64,
    ratio_round_trip: f64,
    samples: usize,
    granted: String,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let cpu = args.cpu.unwrap_or_else(|| Cpus::choose().measured);
    let _alone = lock::acquire()?;
    let blocks = usize::try_from(args.samples)
        .unwrap_or(usize::MAX)
        .div_ceil(BLOCK);
    let (signal, bare, granted) = measure(cpu, blocks)?;

    let json = Json {
        ratio_one_way: ratio(&signal.one_way, &bare.one_way),
        ratio_round_trip: ratio(&signal.round_trip, &bare.round_trip),
        one_way_ns: times(&signal.one_way),
        round_trip_ns: times(&signal.round_trip),
        futex_one_way_ns: times(&bare.one_way),
        futex_round_trip_ns: times(&bare.round_trip),
        samples: signal.one_way.len(),
        granted,
    };
    let mut table = Table::new(&[
        "hand-off",
        "median ns",
        "p99 ns",
        "futex median",
        "futex p99",
        "ratio",
    ]);
    let rows = [
        (
            "one way",
            json.one_way_ns,
            json.futex_one_way_ns,
            json.ratio_one_way,
        ),
        (
            "round trip",
            json.round_trip_ns,
            json.futex_round_trip_ns,
            json.ratio_round_trip,
        ),
    ];
    for (name, ours, theirs, ratio) in rows {
        let numbers = [ours.median, ours.p99, theirs.median, theirs.p99].map(|n| n.to_string());
        table.row(
            [name.to_string()]
                .into_iter()
                .chain(numbers)
                .chain([format!("{ratio:.3}")]),
        );
    }
    println!(
        "{}  {} round trips each, both threads {}",
        table.to_text(),
        json.samples,
        json.granted
    );
    files::write_json(args.json.json.as_deref(), &json)
}

fn times(s: &Sorted) -> Times {
    Times {
        median: s.median(),
        p99: s.percentile(99),
    }
}

/// From a signal to the thread that it wakes, and there and back: the 99th percentiles of some
/// thousand hand-offs on `cpu`, in ns. For estimating overheads.
pub(crate) fn usual(cpu: usize) -> Result<(Nanos, Nanos), Failure> {
    let (signal, _, _) = measure(cpu, 6)?;
    let ns = |sorted: &Sorted| Nanos::try_from(sorted.percentile(99)).unwrap_or(0);
    Ok((ns(&signal.one_way), ns(&signal.round_trip)))
}

/// Ratio of the medians.
fn ratio(ours: &Sorted, theirs: &Sorted) -> f64 {
    ours.median() as f64 / (theirs.median().max(1)) as f64
}

/// What wakes a thread: one waiter, one value.
trait Cell: Send + Sync + 'static {
    fn set(&self);
    fn wait(&self);
}

impl Cell for Signal {
    fn set(&self) {
        Signal::set(self);
    }

    fn wait(&self) {
        Signal::wait(self);
    }
}

impl Cell for BareFutex {
    fn set(&self) {
        BareFutex::set(self);
    }

    fn wait(&self) {
        BareFutex::wait(self);
    }
}

/// Two cells, there and back, and the time at which the far side woke.
struct Pair<C> {
    there: C,
    back: C,
    woke: AtomicU64,
}

/// The samples of one primitive.
struct Samples {
    one_way: Sorted,
    round_trip: Sorted,
}

/// Both primitives in alternating blocks; their samples and the granted policies.
fn measure(cpu: usize, blocks: usize) -> Result<(Samples, Samples, String), Failure> {
    let signals = Arc::new(Pair {
        there: Signal::new(),
        back: Signal::new(),
        woke: AtomicU64::new(0),
    });
    let bare = Arc::new(Pair {
        there: BareFutex::new(),
        back: BareFutex::new(),
        woke: AtomicU64::new(0),
    });
    let done = Arc::new(AtomicBool::new(false));
    let echo = |name: &str| thread(name, cpu, 97);
    let workers = [
        {
            let (pair, done) = (Arc::clone(&signals), Arc::clone(&done));
            spawn(echo("echo/signal"), move || answer(&pair, &done)).map_err(|e| failed(&e))?
        },
        {
            let (pair, done) = (Arc::clone(&bare), Arc::clone(&done));
            spawn(echo("echo/futex"), move || answer(&pair, &done)).map_err(|e| failed(&e))?
        },
    ];
    let caller = {
        let (signals, bare) = (Arc::clone(&signals), Arc::clone(&bare));
        move || {
            let mut ours = (Vec::new(), Vec::new());
            let mut theirs = (Vec::new(), Vec::new());
            for samples in [&mut ours, &mut theirs] {
                samples.0.reserve(blocks * BLOCK);
                samples.1.reserve(blocks * BLOCK);
            }
            for _ in 0..blocks {
                block(&signals, &mut ours);
                block(&bare, &mut theirs);
                // Keeps far from the RT throttle, whatever the number of samples.
                clock::sleep_until(clock::monotonic() + SEC / 1_000);
            }
            (ours, theirs, granted(current_tid()).map(|g| g.to_string()))
        }
    };
    let result = spawn(thread("caller", cpu, 98), caller)
        .map_err(|e| failed(&e))?
        .join();
    done.store(true, Ordering::Release);
    signals.there.set();
    bare.there.set();
    for worker in workers {
        worker.join().map_err(|_| failed(&"a thread panicked"))?;
    }
    let (ours, theirs, granted) = result.map_err(|_| failed(&"a thread panicked"))?;
    let sorted = |(one, round): (Vec<i64>, Vec<i64>)| Samples {
        one_way: Sorted::new(one),
        round_trip: Sorted::new(round),
    };
    Ok((
        sorted(ours),
        sorted(theirs),
        granted.map_err(|e| failed(&e))?,
    ))
}

/// FIFO if it is granted, else the best there is; `granted` tells.
fn thread(name: &str, cpu: usize, priority: u8) -> ThreadSpec {
    let policy = match Policy::fifo(priority) {
        Ok(fifo) if machine::privilege().real_time() => fifo,
        _ => Policy::Other,
    };
    ThreadSpec::new(name).policy(policy).cpu(cpu)
}

fn failed(e: &dyn Display) -> Failure {
    Failure::refused(format!("bench handoff: {e}"))
}

/// The far side.
fn answer<C: Cell>(pair: &Pair<C>, done: &AtomicBool) {
    loop {
        pair.there.wait();
        if done.load(Ordering::Acquire) {
            return;
        }
        pair.woke.store(clock::monotonic(), Ordering::Release);
        pair.back.set();
    }
}

/// One block of round trips.
fn block<C: Cell>(pair: &Pair<C>, samples: &mut (Vec<i64>, Vec<i64>)) {
    for _ in 0..BLOCK {
        let sent = clock::monotonic();
        pair.there.set();
        pair.back.wait();
        let back = clock::monotonic();
        let ns = |t: Nanos| i64::try_from(t.saturating_sub(sent)).unwrap_or(i64::MAX);
        samples.0.push(ns(pair.woke.load(Ordering::Acquire)));
        samples.1.push(ns(back));
    }
}

//! `replenish bench recorder`: what an event costs the thread that records it, with the time given,
//! with a clock reading, and while a reader copies the ring; and what recording, and a chain, add
//! to a message.
//!
//! The rings are those that an executor's threads have: 256 KiB in memory that was touched. Costs
//! are the least of the rounds: what a machine adds, it adds to some.

use super::{dispatch, lttng};
use replenish_cli::lock;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_os::live::SharedMemory;
use replenish_os::{ThreadSpec, clock, spawn};
use replenish_recorder::{Event, Kind, Writer, read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Bytes of an executor's ring, and how many events that are.
const RING: usize = 64 + 8192 * 32;
const SLOTS: usize = 8192;
/// Events of a round.
const ROUND: u64 = 100_000;
/// The reader looks this often.
const PAUSE: Duration = Duration::from_micros(200);

/// Options of `bench recorder`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Events that the reader beside the writer gets at least.
    #[arg(long, value_name = "N", default_value_t = 10_000_000,
          value_parser = clap::value_parser!(u64).range(100_000..=1_000_000_000))]
    events: u64,

    /// Times 0.4 s, of an executor that records and of one that does not, and of one that measures
    /// a chain and of one that does not; 0: none of them is measured.
    #[arg(long, value_name = "N", default_value_t = 20,
          value_parser = clap::value_parser!(u64).range(0..=1000))]
    windows: u64,

    /// The CPU that records.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    #[command(flatten)]
    json: JsonOption,
}

/// `bench recorder --json`. The names are a contract.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
struct Json {
    /// One event with a time that is known.
    given_ns: f64,
    /// One event with a reading of the clock.
    clock_ns: f64,
    /// As `given_ns`, while another thread copies the ring.
    with_reader_ns: f64,
    /// Records that the reader got and that were not whole.
    torn: u64,
    /// Records that it got.
    read: u64,
    /// Records that it got or lost: all that were written.
    written: u64,
    /// An `LTTng-UST` tracepoint with the same fields, recorded in memory; `null` without one.
    lttng_ns: Option<f64>,
    /// CPU time per message of an executor that records against one that does not: the median over
    /// pairs of windows.
    dispatch_ratio: Option<f64>,
    /// The same of an executor that records, with each message an instance of a chain against none.
    chain_ratio: Option<f64>,
}

fn event(n: u64, time: u64) -> Event {
    Event {
        time,
        kind: Kind::Mark,
        name: 1,
        a: n,
        b: !n,
    }
}

/// The least time of an event over the rounds, in nanoseconds.
fn least(rounds: u64, mut round: impl FnMut()) -> f64 {
    let mut least = u64::MAX;
    for _ in 0..rounds {
        let begin = clock::monotonic();
        round();
        least = least.min(clock::monotonic().saturating_sub(begin));
    }
    least as f64 / ROUND as f64
}

/// Reads along until the writer has ended: records read, all records, torn ones.
fn reader(
    ring: &SharedMemory,
    done: &AtomicBool,
    progress: &std::sync::atomic::AtomicU64,
) -> [u64; 3] {
    let mut copy = vec![[0; 4]; SLOTS];
    let ([mut got, mut lost, mut torn], mut from) = ([0; 3], 0);
    loop {
        let last = done.load(Ordering::Acquire);
        let copied = read(ring, from, &mut copy, |event| {
            torn += u64::from(event.b != !event.a || event.kind != Kind::Mark);
        });
        (from, got, lost) = (copied.next, got + copied.read, lost + copied.overwritten);
        torn += copied.torn;
        progress.store(got, Ordering::Relaxed);
        if last {
            return [got, got + lost, torn];
        }
        std::thread::sleep(PAUSE);
    }
}

fn measure(events: u64) -> Result<Json, Failure> {
    let ring = Arc::new(SharedMemory::private(RING).map_err(Failure::refused)?);
    let mut writer = Writer::new(ring.len()).ok_or_else(|| Failure::refused("no ring"))?;
    let mut n = 0;
    let given_ns = least(200, || {
        for _ in 0..ROUND {
            n += 1;
            writer.write(&ring, &event(n, n));
        }
    });
    let clock_ns = least(20, || {
        for _ in 0..ROUND {
            n += 1;
            writer.write(&ring, &event(n, clock::monotonic()));
        }
    });
    let before = writer.written();
    let done = Arc::new(AtomicBool::new(false));
    let progress = Arc::new(std::sync::atomic::AtomicU64::new(0));
    let theirs = (Arc::clone(&ring), Arc::clone(&done), Arc::clone(&progress));
    let reading = std::thread::spawn(move || reader(&theirs.0, &theirs.1, &theirs.2));
    let mut with_reader_ns = f64::MAX;
    while progress.load(Ordering::Relaxed) < events {
        let round = least(1, || {
            for _ in 0..ROUND {
                n += 1;
                writer.write(&ring, &event(n, n));
            }
        });
        with_reader_ns = with_reader_ns.min(round);
    }
    done.store(true, Ordering::Release);
    let gone = |_| Failure::refused("the reader panicked");
    let [read, written, torn] = reading.join().map_err(gone)?;
    if written != writer.written() || written < before {
        return Err(Failure::refused(format!(
            "{written} events read or lost, and {} written",
            writer.written()
        )));
    }
    let round = |x: f64| (x * 100.0).round() / 100.0;
    Ok(Json {
        given_ns: round(given_ns),
        clock_ns: round(clock_ns),
        with_reader_ns: round(with_reader_ns),
        torn,
        read,
        written,
        ..Json::default()
    })
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let cpu = args.cpu.unwrap_or_else(|| Cpus::choose().measured);
    let mut json = {
        let _alone = lock::acquire()?;
        let events = args.events;
        let writer = spawn(ThreadSpec::new("recorder").cpu(cpu), move || {
            measure(events)
        });
        let writer = writer.map_err(Failure::refused)?;
        writer
            .join()
            .map_err(|_| Failure::refused("the writer panicked"))??
    };
    json.lttng_ns = lttng::measure_or_say(cpu);
    if args.windows > 0 {
        json.dispatch_ratio = Some(dispatch::recorder_ratio(cpu, args.windows)?);
        json.chain_ratio = Some(dispatch::chain_ratio(cpu, args.windows)?);
    }
    println!(
        "One event, on CPU {cpu}: {:.2} ns with the time given, {:.2} ns with a clock reading, \
         {:.2} ns beside a reader\nRead beside the writer: {} of {} events, {} torn",
        json.given_ns, json.clock_ns, json.with_reader_ns, json.read, json.written, json.torn,
    );
    if let Some(ratio) = json.dispatch_ratio {
        println!("CPU time of a message with the recorder on against off: {ratio:.4}");
    }
    if let Some(ratio) = json.chain_ratio {
        println!("CPU time of a message in a chain against one in none: {ratio:.4}");
    }
    match json.lttng_ns {
        Some(ns) => println!(
            "A tracepoint of LTTng-UST: {ns:.2} ns, {:.1} times an event with the time given, {:.1} \
             times one with a clock reading",
            ns / json.given_ns,
            ns / json.clock_ns
        ),
        None => println!("LTTng-UST: not measured"),
    }
    files::write_json(args.json.json.as_deref(), "bench-recorder", &json)
}

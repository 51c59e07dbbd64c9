//! `replenish bench handoff`: waking a worker through `replenish_os::Notify`, against a bare futex.
//!
//! Two FIFO threads on one CPU, as dispatcher and worker are: the upper one signals the lower one
//! and waits for its answer. Both primitives take turns in blocks, so that both see the same
//! machine.

use replenish_cli::handoff::{self, BLOCK, Cell, Echo};
use replenish_cli::lock;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::machine::stats::Sorted;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::Outcome;
use replenish_cli::report::files;
use replenish_cli::report::table::Table;
use replenish_os::Notify;
use replenish_os::baseline::BareFutex;

/// Options of `bench handoff`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Round trips per primitive.
    #[arg(long, value_name = "N", default_value_t = 20_000,
          value_parser = clap::value_parser!(u64).range(1_000..=1_000_000))]
    samples: u64,

    /// The CPU of both threads.
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
    let echoes = [
        Echo::start("echo/signal", cpu, Notify::new(), Notify::new())?,
        Echo::start("echo/futex", cpu, bare(), bare())?,
    ];
    let ([signal, bare], granted) = handoff::measure(cpu, blocks, echoes)?;

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
    files::write_json(args.json.json.as_deref(), "bench-handoff", &json)
}

fn times(s: &Sorted) -> Times {
    Times {
        median: s.median(),
        p99: s.percentile(99),
    }
}

/// Ratio of the medians.
fn ratio(ours: &Sorted, theirs: &Sorted) -> f64 {
    ours.median() as f64 / (theirs.median().max(1)) as f64
}

/// The baseline.
struct Bare(BareFutex);

fn bare() -> Bare {
    Bare(BareFutex::new())
}

impl Cell for Bare {
    fn set(&self) {
        self.0.set();
    }

    fn wait(&self) {
        self.0.wait();
    }
}

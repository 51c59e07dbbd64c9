//! Options, windows in turns, and figures of `bench enforcement`.

use super::bare_timer::BareTimer;
use super::baseline::Baseline;
use super::schedule::Schedule;
use super::shares;
use super::spinners::Spinners;
use crate::load::spec::MONITOR_PRIORITY;
use crate::load::{MS, Nanos};
use crate::options;
use crate::report::progress::Progress;
use crate::testbench::summary::{as_f64, round};
use replenish_cli::lock;
use replenish_cli::machine;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::report::table::{Table, percent};
use replenish_cli::signals::Stop;
use replenish_os::{ThreadSpec, clock, spawn};

/// The period of every budget.
const PERIOD: Nanos = 100 * MS;
/// The sum of all budgets, per period.
const TOTAL: Nanos = 80 * MS;

/// Options of `bench enforcement`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Numbers of workers; 80 % of the CPU is split evenly among them.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', default_value = "1,4,16",
          value_parser = clap::value_parser!(u64).range(1..=64))]
    workers: Vec<u64>,

    /// Windows of 0.4 s per number of workers, as many for the baseline and for the bare timer.
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = options::windows())]
    windows: u64,

    /// Measure shares instead: how much CPU time hungry workers get in the long run, from 0.05 ms
    /// per 0.5 ms to 23 per 70 and 32 workers of 2.5 per 100, each for so many seconds.
    #[arg(long, value_name = "SECONDS", conflicts_with_all = ["workers", "windows"],
          value_parser = clap::value_parser!(u64).range(1..=600))]
    shares: Option<u64>,

    /// The CPU to measure on.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    #[command(flatten)]
    json: JsonOption,
}

/// From the start of the threads to the first window.
const LEAD: Nanos = 200 * MS;

/// Half and 99 % of the samples are no larger, in microseconds.
#[derive(Debug, Clone, Copy, serde::Serialize)]
struct Spread {
    median: f64,
    p99: f64,
    max: f64,
    count: usize,
}

impl Spread {
    fn of(s: &Sorted) -> Self {
        Self {
            median: us(s.median()),
            p99: us(s.percentile(99)),
            max: us(s.max()),
            count: s.len(),
        }
    }
}

/// One number of workers. The first six names are a contract.
#[derive(Debug, Clone, serde::Serialize)]
struct Point {
    workers: u64,
    overrun_us: Spread,
    /// Overruns during which the machine stood still, in microseconds.
    stalls: Vec<f64>,
    posix_timer_overrun_us: Spread,
    /// Median of the baseline over our median (at least 1 µs).
    ratio: f64,
    enforcer_cpu_percent: f64,
    /// The largest deviation of a worker's CPU time at high priority, in percent of its budget.
    worst_budget_error_percent: f64,
    /// Windows left out of the shares: another thread had the CPU, or the machine stood still.
    windows_disturbed: u64,
    enforcer_wakes_per_second: f64,
    budget_ms: f64,
    /// A thread that makes the enforcer's system calls at its times, and decides nothing.
    bare_cpu_percent: f64,
    bare_wakes_per_second: f64,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let privilege = machine::privilege();
    if !privilege.real_time() {
        return Err(Failure::refused(format!(
            "bench enforcement needs real-time priority: {privilege}"
        )));
    }
    let cpus = Cpus::choose();
    let cpu = args.cpu.unwrap_or(cpus.measured);
    let stop = Stop::on_signals()?;
    let _alone = lock::acquire()?;
    if let Some(seconds) = args.shares {
        return measure_shares(cpu, cpus.support, seconds, &stop, args);
    }
    let mut points = Vec::new();
    for &workers in &args.workers {
        let point = measure(cpu, cpus.support, workers, args.windows, &stop)?;
        if stop.is_triggered() {
            return Err(Failure::refused("interrupted"));
        }
        points.push(point);
    }
    println!("{}", table(&points).to_text());
    println!(
        "  Overrun: CPU time at high priority beyond the budget, by the worker's CPU clock.\n  \
         Ratio: median of a POSIX CPU timer in the same run over ours (at least 1 us).\n  \
         Bare: a thread that makes the enforcer's system calls at its times and decides nothing."
    );
    for p in points.iter().filter(|p| !p.stalls.is_empty()) {
        println!(
            "  {} workers: the machine stood still {} times: {:?} us",
            p.workers,
            p.stalls.len(),
            p.stalls
        );
    }
    files::write_json(
        args.json.json.as_deref(),
        "bench-enforcement",
        &serde_json::json!({ "points": points }),
    )
}

fn measure_shares(cpu: usize, support: usize, seconds: u64, stop: &Stop, args: &Args) -> Outcome {
    let spec = ThreadSpec::new("monitor")
        .policy(fifo_or_other(MONITOR_PRIORITY))
        .cpu(support);
    let stop = stop.clone();
    let monitor = spawn(spec, move || shares::measure(cpu, seconds, &stop));
    let monitor = monitor.map_err(Failure::refused)?;
    let shares = monitor
        .join()
        .map_err(|_| Failure::refused("the monitor panicked"))??;
    println!("{}", shares::table(&shares).to_text());
    println!("  CPU time by the kernel's clocks of the threads, which stop without budget.");
    files::write_json(
        args.json.json.as_deref(),
        "bench-shares",
        &serde_json::json!({ "shares": shares }),
    )
}

fn measure(
    cpu: usize,
    support: usize,
    workers: u64,
    windows: u64,
    stop: &Stop,
) -> Result<Point, Failure> {
    let budget = TOTAL / workers.max(1);
    let [ours, theirs, bare] = Schedule::turns(clock::monotonic() + LEAD + workers * MS, windows);
    let count = usize::try_from(workers).unwrap_or(1);
    let spinners = Spinners::start(cpu, count, budget, PERIOD, ours, stop)?;
    let baseline = Baseline::start(cpu, budget, theirs, stop)?;
    let bare = BareTimer::start(cpu, count, budget, PERIOD, bare, stop)?;

    let spec = ThreadSpec::new("monitor")
        .policy(fifo_or_other(MONITOR_PRIORITY))
        .cpu(support);
    let total = usize::try_from(windows).unwrap_or(usize::MAX);
    let stopping = stop.clone();
    let body = move || {
        let mut progress = Progress::new();
        let mut n = 0;
        let measured = spinners.measure(ours, &stopping, &mut || {
            n += 1;
            progress.step(
                n,
                total,
                &format!("{workers} workers of {:.1} ms", as_f64(budget) / 1e6),
            );
        });
        spinners.finish(measured)
    };
    let monitor = spawn(spec, body).map_err(Failure::refused)?;
    let m = monitor
        .join()
        .map_err(|_| Failure::refused("the monitor panicked"))??;
    let posix = Sorted::new(baseline.finish()?);
    let bare = bare.finish()?;
    let overruns = Sorted::new(m.overruns);

    let expected = as_f64(budget) * as_f64(m.undisturbed_time) / as_f64(PERIOD);
    let error = |high: &Nanos| (as_f64(*high) - expected) * 100.0 / expected.max(1.0);
    let worst = m
        .high
        .iter()
        .map(error)
        .fold(0.0, |w: f64, e| if e.abs() > w.abs() { e } else { w });
    Ok(Point {
        workers,
        overrun_us: Spread::of(&overruns),
        stalls: m.stalls.iter().map(|s| us(*s)).collect(),
        posix_timer_overrun_us: Spread::of(&posix),
        ratio: round(us(posix.median()) / us(overruns.median()).abs().max(1.0)),
        enforcer_cpu_percent: round(as_f64(m.enforcer_cpu) * 100.0 / as_f64(m.time.max(1))),
        worst_budget_error_percent: round(worst),
        windows_disturbed: m.disturbed,
        enforcer_wakes_per_second: round(m.wakes as f64 * 1e9 / as_f64(m.time.max(1))),
        budget_ms: as_f64(budget) / 1e6,
        bare_cpu_percent: round(as_f64(bare.cpu) * 100.0 / as_f64(bare.time.max(1))),
        bare_wakes_per_second: round(bare.wakes as f64 * 1e9 / as_f64(bare.time.max(1))),
    })
}

fn table(points: &[Point]) -> Table {
    let mut table = Table::new(&[
        "workers",
        "budget ms",
        "overrun median us",
        "p99 us",
        "exhaustions",
        "stalls",
        "POSIX timer median us",
        "ratio",
        "enforcer CPU",
        "wakes/s",
        "bare CPU",
        "bare wakes/s",
        "worst share error",
        "disturbed",
    ]);
    for p in points {
        table.row([
            p.workers.to_string(),
            format!("{:.2}", p.budget_ms),
            format!("{:.1}", p.overrun_us.median),
            format!("{:.1}", p.overrun_us.p99),
            p.overrun_us.count.to_string(),
            p.stalls.len().to_string(),
            format!("{:.0}", p.posix_timer_overrun_us.median),
            format!("{:.0}", p.ratio),
            format!("{:.3} %", p.enforcer_cpu_percent),
            format!("{:.0}", p.enforcer_wakes_per_second),
            format!("{:.3} %", p.bare_cpu_percent),
            format!("{:.0}", p.bare_wakes_per_second),
            percent(p.worst_budget_error_percent),
            p.windows_disturbed.to_string(),
        ]);
    }
    table
}

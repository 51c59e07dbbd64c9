//! `replenish suggest`: budgets for a program, from what its callbacks take while it runs.
//!
//! ```text
//!   recording ─► callbacks: each one's executions, its period ─► histogram ─┐
//!   /proc ─► observe ─► rhythm: of threads without a recording ─────────────┴─► table, file, JSON
//! ```
//!
//! `replenish suggest -- ./my_program` starts it, `--pid` looks at one that runs. What a worker's
//! callbacks took at most in any period, plus a margin, becomes its guarantee in a deployment file,
//! which `replenish plan` checks. A thread of a program without replenish is a worker by its name.
//! A measurement is no bound: it says what was seen, and how often was looked.

mod callbacks;
mod histogram;
mod observe;
mod rhythm;

use super::plan::ms;
use crate::options::{self, JsonOption};
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::report::table::{Table, percent};
use crate::signals::Stop;
use crate::time::{MS, Nanos};
use callbacks::{Callback, Follower, Worker};
use observe::{Observer, Seen};
use replenish_os::clock;
use replenish_plan::{Guarantee, Template, TemplateWorker};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Between two samples.
const SAMPLE: Duration = Duration::from_millis(2);
/// Fewer recorded callbacks than this say less than the thread's CPU time.
const ENOUGH: u64 = 3;
/// Between two looks at the program's recording.
const LOOK: Duration = Duration::from_millis(250);
/// Budgets are rounded up to this.
const STEP: Nanos = MS / 10;
/// The longest time that a program takes to end after it was asked to.
const WIND_DOWN: Duration = Duration::from_secs(2);

/// Options of `suggest`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A process that runs, instead of a program to start.
    #[arg(long, value_name = "PID", conflicts_with = "program",
          value_parser = clap::value_parser!(u32).range(1..))]
    pid: Option<u32>,

    /// For how long to look, in seconds; a program that was started is ended then.
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: u64,

    /// Period of all budgets, in milliseconds. Without it each worker's own: the shortest of its
    /// callbacks' periods. Of a thread that is not recorded, how often it waits for something to
    /// do, as the kernel counts it; 100 if it hardly did.
    #[arg(long, value_name = "MS", value_parser = options::period())]
    period: Option<u64>,

    /// Margin that is added to the most that was seen, in percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 20, value_parser = clap::value_parser!(u64).range(0..=400))]
    margin: u64,

    /// Where to write the deployment file.
    #[arg(long, value_name = "PATH", default_value = "suggested.toml")]
    out: PathBuf,

    #[command(flatten)]
    json: JsonOption,

    /// The program to start, and its arguments.
    #[arg(last = true, value_name = "PROGRAM", required_unless_present = "pid")]
    program: Vec<String>,
}

/// Executions by time.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
struct BucketJson {
    up_to_ms: f64,
    count: u64,
}

/// Executions seen of one callback. The names are a contract.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
struct CallbackJson {
    id: String,
    executions: u64,
    /// The mean time between two releases.
    released_every_ms: Option<f64>,
    p50_ms: f64,
    p99_ms: f64,
    max_ms: f64,
    /// For this callback alone, if it had a worker of its own.
    suggested_budget_ms: f64,
    period_ms: f64,
    histogram: Vec<BucketJson>,
}

/// The suggestion for one worker. The names are a contract.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
struct Row {
    id: String,
    /// `recording`, or `threads`: from the CPU times of threads.
    from: &'static str,
    /// Of a recorded worker.
    callbacks: Vec<CallbackJson>,
    /// Number of threads with this name; the hungriest counts.
    threads: u64,
    /// The kernel may have cut the name.
    name_may_be_cut: bool,
    /// The mean time between two waits, if it waited often enough to tell.
    wakes_every_ms: Option<f64>,
    /// The most CPU time seen in any period. Not a bound.
    max_observed_ms: f64,
    /// Periods that were looked at.
    samples: u64,
    margin_percent: u64,
    suggested_budget_ms: f64,
    period_ms: f64,
    cpu_percent: f64,
    #[serde(skip)]
    budget: Nanos,
    #[serde(skip)]
    period: Nanos,
}

/// Looks, suggests, writes.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    let existed = args.out.exists();
    files::check_writable(Some(&args.out))?;
    let stop = Stop::on_signals()?;
    let result = observe(args, &stop).and_then(|rows| report(args, &rows));
    if result.is_err() && !existed {
        std::fs::remove_file(&args.out).ok(); // it was ours, and is empty
    }
    result
}

fn observe(args: &Args, stop: &Stop) -> Result<Vec<Row>, Failure> {
    let mut started = match args.program.split_first() {
        Some((program, arguments)) => {
            let mut command = Command::new(program);
            command.args(arguments).stdin(Stdio::null());
            let child = command
                .spawn()
                .map_err(|e| Failure::refused(format!("cannot start {program}: {e}")))?;
            Some(Started(child))
        }
        None => None,
    };
    let pid = started.as_ref().map_or(args.pid, |s| Some(s.0.id()));
    let pid = pid.ok_or_else(|| Failure::Usage("either --pid or a program is needed".into()))?;
    remark!("watching process {pid} for {} s …", args.seconds);
    let mut observer = Observer::new(pid, args.period.map(options::ms));
    let mut follower = Follower::default();
    let (mut names, mut looked) = (Vec::new(), None::<Instant>);
    let end = Instant::now() + Duration::from_secs(args.seconds);
    let mut seen = false;
    while Instant::now() < end {
        let gone = started.as_mut().is_some_and(Started::has_ended);
        if gone || !observer.sample(clock::monotonic()) {
            break;
        }
        seen = true;
        // While it runs: its recording ends with it.
        if looked.is_none_or(|at| at.elapsed() >= LOOK) {
            looked = Some(Instant::now());
            names = follower.look(pid).into_iter().chain(names).collect();
            names.sort_unstable();
            names.dedup();
        }
        if stop.wait(SAMPLE) {
            break; // what was seen so far counts
        }
    }
    drop(started);
    if !seen {
        return Err(Failure::refused(format!(
            "there is no process {pid} whose threads can be seen"
        )));
    }
    let recorded = follower.workers();
    let threads = observer.workers(&names);
    let rows = threads.iter().map(|seen| {
        let worker = recorded.iter().find(|worker| worker.name == seen.name);
        match worker.filter(|worker| worker.executions() >= ENOUGH) {
            Some(worker) => by_callbacks(args, worker, seen),
            None => row(args, seen),
        }
    });
    let rows: Vec<Row> = rows.collect();
    if rows.is_empty() {
        return Err(Failure::refused(format!(
            "process {pid} had no thread besides its first one for {} ms",
            args.period.unwrap_or(rhythm::UNKNOWN)
        )));
    }
    Ok(rows)
}

/// The budget for what was seen at most.
fn budget(args: &Args, most: Nanos, period: Nanos) -> Nanos {
    let with_margin = most.saturating_mul(100 + args.margin) / 100;
    let budget = with_margin.div_ceil(STEP).max(1) * STEP;
    budget.min(period)
}

fn by_callbacks(args: &Args, worker: &Worker, seen: &Seen) -> Row {
    let period = args.period.map_or_else(|| worker.period(), options::ms);
    let most = worker.most_in(period);
    let budget = budget(args, most, period);
    let callback = |callback: &Callback| callback_row(args, callback);
    Row {
        from: "recording",
        callbacks: worker.callbacks.iter().map(callback).collect(),
        name_may_be_cut: false,
        max_observed_ms: ms(most),
        samples: worker.executions(),
        suggested_budget_ms: ms(budget),
        period_ms: ms(period),
        budget,
        period,
        ..row(args, seen)
    }
}

fn callback_row(args: &Args, callback: &Callback) -> CallbackJson {
    let times = &callback.times;
    let period = args.period.map_or_else(|| callback.period(), options::ms);
    let budget = budget(args, callback.most_in(period), period);
    let bucket = |bucket: histogram::Bucket| BucketJson {
        up_to_ms: ms(bucket.end),
        count: bucket.count,
    };
    CallbackJson {
        id: callback.id.clone(),
        executions: times.count(),
        released_every_ms: callback.interval().map(ms),
        p50_ms: ms(times.percentile(50)),
        p99_ms: ms(times.percentile(99)),
        max_ms: ms(times.most),
        suggested_budget_ms: ms(budget),
        period_ms: ms(period),
        histogram: times.buckets().map(bucket).collect(),
    }
}

fn row(args: &Args, seen: &Seen) -> Row {
    let period = seen.period;
    let budget = budget(args, seen.most, period);
    Row {
        id: seen.name.replace('/', "-"),
        from: "threads",
        callbacks: Vec::new(),
        threads: seen.threads,
        name_may_be_cut: seen.may_be_cut(),
        wakes_every_ms: seen.rhythm.interval().map(ms),
        max_observed_ms: ms(seen.most),
        samples: seen.windows,
        margin_percent: args.margin,
        suggested_budget_ms: ms(budget),
        period_ms: ms(period),
        cpu_percent: (seen.rhythm.percent() * 1e3).round() / 1e3,
        budget,
        period,
    }
}

fn report(args: &Args, rows: &[Row]) -> Outcome {
    let mut table = Table::new(&[
        "worker",
        "wakes every",
        "most seen",
        "in any",
        "looked at",
        "margin",
        "suggested budget",
        "mean CPU",
    ]);
    for r in rows {
        table.row([
            r.id.clone(),
            r.wakes_every_ms
                .map_or_else(|| "-".into(), |every| format!("{every:.1} ms")),
            format!("{:.3} ms", r.max_observed_ms),
            format!("{:.0} ms", r.period_ms),
            match r.from {
                "recording" => format!("{} callbacks", r.samples),
                _ => format!("{} times", r.samples),
            },
            format!("{} %", r.margin_percent),
            format!("{:.1} ms", r.suggested_budget_ms),
            percent(r.cpu_percent),
        ]);
    }
    println!("{}", table.to_text());
    for callback in rows.iter().flat_map(|r| &r.callbacks) {
        print_histogram(callback);
    }
    files::write(&args.out, &template(args, rows).to_string())?;
    println!(
        "Written to {out}. These are measurements, not bounds: a rare case that did not happen \
         while we\nlooked can need more. Look longer, under the worst load you know; then:\n\n  \
         replenish plan {out}",
        out = args.out.display()
    );
    let json = serde_json::json!({
        "seconds": args.seconds,
        "workers": rows,
        "file": args.out.display().to_string(),
    });
    files::write_json(args.json.json.as_deref(), "suggest", &json)
}

/// The executions that a budget was drawn from.
fn print_histogram(callback: &CallbackJson) {
    let mut text = sentence(callback);
    let most = callback.histogram.iter().map(|b| b.count).max();
    let most = most.unwrap_or(1);
    for bucket in &callback.histogram {
        let cells = (bucket.count * 40).div_ceil(most);
        let bar = "█".repeat(usize::try_from(cells).unwrap_or(0));
        text += &format!(
            "\n  up to {:>9.3} ms {bar} {}",
            bucket.up_to_ms, bucket.count
        );
    }
    println!("{text}\n");
}

fn sentence(c: &CallbackJson) -> String {
    let every = c.released_every_ms;
    let every = every.map_or("once".into(), |every| format!("every {every:.1} ms"));
    format!(
        "{}: {} executions, {every}; half took up to {:.3} ms, 99 % up to {:.3} ms, the longest {:.3} ms",
        c.id, c.executions, c.p50_ms, c.p99_ms, c.max_ms
    )
}

fn template(args: &Args, rows: &[Row]) -> Template {
    let worker = |r: &Row| TemplateWorker {
        comments: comments(args, r),
        name: r.id.clone(),
        guarantee: Some(
            Guarantee::of(Duration::from_nanos(r.budget)).every(Duration::from_nanos(r.period)),
        ),
        ..TemplateWorker::default()
    };
    Template {
        header: vec![
            "Suggested by `replenish suggest` from measured CPU times.".into(),
            "Measurements, not bounds: what did not happen while it looked is not in here.".into(),
            "Periods are a guess from how often a worker had something to do: correct them by its \
             job."
                .into(),
        ],
        machine: None,
        workers: rows.iter().map(worker).collect(),
    }
}

/// Where the figures of a worker come from.
fn comments(args: &Args, r: &Row) -> Vec<String> {
    let mut comments = vec![match (args.period, r.wakes_every_ms) {
        (Some(_), _) => "period: as asked for".into(),
        _ if !r.callbacks.is_empty() => "period: the shortest of its callbacks' periods".into(),
        (None, Some(every)) => format!("period: it wakes every {every:.1} ms"),
        (None, None) => "period: it hardly waited, so that 100 ms is no more than a start".into(),
    }];
    let looked = if r.callbacks.is_empty() {
        "periods looked at"
    } else {
        "callbacks"
    };
    comments.push(format!(
        "most seen: {:.3} ms in any {} ms, {} {looked}; + {} %",
        r.max_observed_ms, r.period_ms, r.samples, r.margin_percent
    ));
    comments.extend(r.callbacks.iter().map(sentence));
    if r.name_may_be_cut {
        comments.push(
            "the kernel keeps 15 bytes of a name: the worker whose name begins like this is meant"
                .into(),
        );
    }
    comments
}

/// A program of ours: asked to end, then ended, when dropped.
struct Started(Child);

impl Started {
    fn has_ended(&mut self) -> bool {
        !matches!(self.0.try_wait(), Ok(None))
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        if self.has_ended() {
            return;
        }
        let pid = self.0.id().to_string();
        let asked = Command::new("kill").args(["-s", "TERM", &pid]).status();
        let until = Instant::now() + WIND_DOWN;
        while asked.is_ok() && Instant::now() < until && !self.has_ended() {
            std::thread::sleep(SAMPLE);
        }
        // Nothing more can be done about a process that survives this.
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

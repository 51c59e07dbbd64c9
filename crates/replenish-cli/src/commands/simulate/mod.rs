//! `replenish simulate FILE`: a deployment file in virtual time, with its schedule drawn.
//!
//! The same budget servers as at run time, driven by the releases and execution times that the file
//! states. Takes as long as the computation does, whatever the simulated time.
//! `lanes` sorts the run by thread, `gantt` draws it.

pub(super) mod gantt;
pub(super) mod lanes;

use super::plan::ms;
use crate::machine::cpus;
use crate::options::JsonOption;
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::report::html::Page;
use crate::report::table::{Table, percent};
use replenish_plan::{Deployment, Nanos, Plan, Requirement};
use replenish_sim::{Options, Outcome as Simulated, System, ThreadOutcome, simulate};
use std::path::PathBuf;

const MS: Nanos = 1_000_000;
/// The drawing is of this part of a run, in virtual time.
const TRACED: Nanos = 20_000 * MS;

/// Options of `simulate`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The deployment file, for example examples/robot/fits.toml.
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// Length of the run, in seconds of virtual time.
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=3600))]
    seconds: u64,

    /// Draws other execution times and other lateness.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Length of the drawing, in milliseconds: from the start, or around the first missed deadline.
    /// Without it, two of the longest periods.
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    show: Option<u64>,

    /// Simulate it even if the plan is refused, to see what goes wrong.
    #[arg(long)]
    anyway: bool,

    /// Also write a page with the schedule drawn, for a browser.
    #[arg(long, value_name = "PATH")]
    html: Option<PathBuf>,

    /// Also write the drawing as SVG.
    #[arg(long, value_name = "PATH")]
    svg: Option<PathBuf>,

    #[command(flatten)]
    json: JsonOption,
}

/// One thread of the result.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
struct Row {
    id: String,
    cpu: Option<usize>,
    released: u64,
    completed: u64,
    dropped: u64,
    misses: u64,
    worst_response_ms: Option<f64>,
    mean_response_ms: Option<f64>,
    /// The bound of the plan, where it is one for callbacks.
    bound_ms: Option<f64>,
    deadline_ms: Option<f64>,
    cpu_percent: f64,
    background_cpu_percent: f64,
    exhaustions: u64,
}

/// Plans, simulates, draws.
pub(crate) fn run(args: &Args) -> Outcome {
    for path in [&args.json.json, &args.svg, &args.html] {
        files::check_writable(path.as_deref())?;
    }
    let mut deployment = Deployment::read(&args.file).map_err(Failure::refused)?;
    deployment
        .on_host(cpus::allowed())
        .map_err(Failure::refused)?;
    let (plan, refusal) = planned(args, &deployment)?;
    let system = deployment.system(&plan);
    let horizon = args.seconds.saturating_mul(1_000 * MS);
    let shown = args
        .show
        .map_or_else(|| shown(&system), |show| show * MS)
        .min(horizon.min(TRACED));
    let options = |horizon: Nanos| Options::until(horizon).seed(args.seed);
    let outcome = simulate(&system, &options(horizon)).map_err(Failure::refused)?;
    let traced = simulate(&system, &options(horizon.min(TRACED)).traced());
    let traced = traced.map_err(Failure::refused)?;

    let rows: Vec<Row> = outcome
        .threads
        .iter()
        .enumerate()
        .map(|(n, thread)| row(n, thread, &system, &plan, &deployment, horizon))
        .collect();
    let table = table(&rows);
    let verdict = verdict(&rows, args.seconds, refusal.is_none());
    if let Some(refusal) = &refusal {
        println!("The plan is refused: {refusal}\nSimulated all the same:\n");
    }
    println!("{}", table.to_text());
    println!("{verdict}");

    let lanes = lanes::of(&system, &traced);
    let from = start(&lanes, shown, traced.horizon);
    let svg = gantt::draw(&lanes, &deployment.machine.cpus, from..from + shown);
    match &args.html {
        Some(path) => {
            let page = page(args, &table, &svg, &verdict, refusal.as_deref());
            files::write(path, &page)?;
            println!("The schedule is drawn in {}.", path.display());
        }
        None => println!("To see the schedule: --html schedule.html"),
    }
    if let Some(path) = &args.svg {
        files::write(path, &svg)?;
        println!("wrote {}", path.display());
    }
    let json = serde_json::json!({
        "admitted": refusal.is_none(),
        "refusal": refusal,
        "seconds": args.seconds,
        "seed": args.seed,
        "workers": rows,
        "cpus": cpus(&deployment, &outcome),
    });
    files::write_json(args.json.json.as_deref(), "simulate", &json)
}

/// The plan, and why it is refused if it is and is to be simulated all the same.
fn planned(args: &Args, deployment: &Deployment) -> Result<(Plan, Option<String>), Failure> {
    match deployment.plan() {
        Ok(plan) => Ok((plan, None)),
        Err(refusal) => {
            let sentence = refusal.sentence;
            match refusal.attempt.filter(|_| args.anyway) {
                Some(attempt) => Ok((*attempt, Some(sentence))),
                None => Err(Failure::refused(format!(
                    "{} is refused: {sentence} (--anyway simulates it all the same)",
                    args.file.display()
                ))),
            }
        }
    }
}

/// Two of the longest periods of a budget, between 0.1 and 1 s.
fn shown(system: &System) -> Nanos {
    let periods = system.threads.iter().filter_map(|t| t.policy.period());
    let longest = periods.max().unwrap_or(0);
    longest.saturating_mul(2).clamp(100 * MS, 1_000 * MS)
}

/// The time at which the drawing begins: so that the first late callback, if any, is in its last
/// quarter. A round number of 50 ms.
fn start(lanes: &[lanes::Lane], shown: Nanos, horizon: Nanos) -> Nanos {
    let late = lanes.iter().filter_map(|l| l.late.first().copied()).min();
    let Some(late) = late.filter(|late| *late > shown) else {
        return 0;
    };
    let from = late.saturating_sub(shown / 4 * 3) / (50 * MS) * (50 * MS);
    from.min(horizon.saturating_sub(shown))
}

fn row(
    n: usize,
    thread: &ThreadOutcome,
    system: &System,
    plan: &Plan,
    deployment: &Deployment,
    horizon: Nanos,
) -> Row {
    let percent = |time: Nanos| {
        let share = time as f64 * 100.0 / horizon.max(1) as f64;
        (share * 1e3).round() / 1e3
    };
    let spec = system.threads.get(n);
    let planned = plan.workers.get(n);
    // The bound of a budget is about its delivery, not about callbacks, which may need more.
    let scheduling = deployment
        .workers
        .get(n)
        .and_then(|w| w.scheduling.as_ref());
    let is_budget = matches!(scheduling, Some(Requirement::Guarantee(g)) if !g.is_rate());
    let responses = &thread.responses;
    let mean = |sum: Nanos| ms(sum) / responses.len() as f64;
    Row {
        id: spec.map_or_else(String::new, |s| s.name.clone()),
        cpu: spec
            .and_then(|s| s.cpu)
            .and_then(|at| deployment.machine.cpus.get(at).copied()),
        released: thread.released,
        completed: thread.completed,
        dropped: thread.dropped,
        misses: thread.misses,
        worst_response_ms: thread.worst().map(ms),
        mean_response_ms: (!responses.is_empty()).then(|| mean(responses.iter().sum())),
        bound_ms: planned
            .and_then(|p| p.worst_response)
            .filter(|_| !is_budget)
            .map(ms),
        deadline_ms: spec.and_then(|s| s.deadline).map(ms),
        cpu_percent: percent(thread.cpu()),
        background_cpu_percent: percent(thread.cpu_low),
        exhaustions: thread.exhaustions,
    }
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "worker",
        "CPU",
        "released",
        "done",
        "lost",
        "worst response",
        "bound",
        "deadline",
        "missed",
        "CPU time",
        "of it in background",
        "budget used up",
    ]);
    let time = |t: Option<f64>| t.map_or_else(|| "-".into(), |t| format!("{t:.3} ms"));
    for r in rows {
        table.row([
            r.id.clone(),
            r.cpu.map_or_else(|| "any".into(), |c| c.to_string()),
            r.released.to_string(),
            r.completed.to_string(),
            r.dropped.to_string(),
            time(r.worst_response_ms),
            time(r.bound_ms),
            time(r.deadline_ms),
            match r.deadline_ms {
                Some(_) => r.misses.to_string(),
                None => "-".into(),
            },
            percent(r.cpu_percent),
            percent(r.background_cpu_percent),
            r.exhaustions.to_string(),
        ]);
    }
    table
}

/// The result in a sentence, for a hurried reader.
fn verdict(rows: &[Row], seconds: u64, admitted: bool) -> String {
    let late: Vec<String> = rows
        .iter()
        .filter(|r| r.misses > 0)
        .map(|r| format!("{} ({} of {})", r.id, r.misses, r.completed))
        .collect();
    let with_deadline = rows.iter().filter(|r| r.deadline_ms.is_some()).count();
    let begun = format!("In {seconds} s of virtual time");
    match (late.as_slice(), admitted) {
        ([], _) => format!(
            "{begun} no deadline was missed by any of the {with_deadline} workers that have one."
        ),
        (late, true) => format!(
            "{begun} deadlines were missed by {}. Its callbacks take more CPU time than the \
             guarantee says; everybody who keeps to it is in time.",
            late.join(", ")
        ),
        (late, false) => format!(
            "{begun} deadlines were missed by {}. That is why the plan is refused.",
            late.join(", ")
        ),
    }
}

fn cpus(deployment: &Deployment, outcome: &Simulated) -> Vec<serde_json::Value> {
    let percent = |time: &Nanos| *time as f64 * 100.0 / outcome.horizon.max(1) as f64;
    let cpus = deployment.machine.cpus.iter();
    cpus.zip(outcome.idle.iter().zip(&outcome.overhead))
        .map(|(cpu, (idle, overhead))| {
            serde_json::json!({
                "cpu": cpu,
                "idle_percent": percent(idle),
                "overhead_percent": percent(overhead),
            })
        })
        .collect()
}

fn page(args: &Args, table: &Table, svg: &str, verdict: &str, refusal: Option<&str>) -> String {
    let mut page = Page::new(
        &format!("The schedule of {}", args.file.display()),
        "Simulated in virtual time by `replenish simulate`, with the budget servers of the run time.",
    );
    if let Some(refusal) = refusal {
        page.warning(&format!(
            "The plan is refused: {refusal} This is what happens if it is run all the same."
        ));
    }
    page.answer(verdict);
    page.figure(
        svg,
        "Dark: the worker runs within its budget (or has none to hold). Light: it runs in the \
         background. Above it, what its budget has left: it falls while the worker runs and comes \
         back one period after it was used. Triangles: releases. Red: the end of a callback that \
         was late.",
    );
    page.heading(&format!("{} s of virtual time", args.seconds));
    page.table(table);
    page.text(&format!(
        "Execution times and lateness are drawn with seed {}; another `--seed` draws others. The \
         bound is of the plan: no run exceeds it as long as callbacks take no more than stated.",
        args.seed
    ));
    page.finish(&format!("replenish {}", env!("CARGO_PKG_VERSION")))
}

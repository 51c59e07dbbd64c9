//! The command: its options, its table, its JSON.

use super::advice;
use super::parts::{Cause, Parts, named, take_apart};
use super::recorded::{Recorded, recorded};
use crate::live::select;
use crate::live::timeline::Late;
use crate::options::{self, JsonOption};
use crate::outcome::Outcome;
use crate::report::files;
use crate::time::Nanos;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Most late callbacks that are printed; `--json` has all.
const PRINTED: usize = 10;

/// Most late callbacks that are taken apart, the newest.
const MOST: usize = 5000;

/// Options of `why`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The program: its name, its process id, or its file (also of a program that was killed).
    #[arg(value_name = "PROGRAM|FILE")]
    program: String,

    /// Only callbacks that ended in the last part of the recording: 5s, 200ms.
    #[arg(long, value_name = "TIME", value_parser = options::last)]
    last: Option<Nanos>,

    /// The deployment file that the change is for; its other workers are planned beside. Without
    /// it, the budgets of the recording are.
    #[arg(long, value_name = "FILE")]
    deployment: Option<PathBuf>,

    #[command(flatten)]
    json: JsonOption,
}

/// The time of one party in one cause.
#[derive(Debug, serde::Serialize)]
struct ByJson {
    cause: &'static str,
    by: String,
    ns: Nanos,
}

/// A late callback. The first three names are a contract.
#[derive(Debug, serde::Serialize)]
struct LateJson {
    handle: String,
    /// From its release to its end: the sum of `parts`.
    response_ns: Nanos,
    /// Cause → ns.
    parts: BTreeMap<&'static str, Nanos>,
    worker: String,
    deadline_ns: Nanos,
    lateness_ns: Nanos,
    /// `CLOCK_MONOTONIC`.
    released_at_ns: Nanos,
    /// The fewest parts without which the deadline would have been met, the largest first.
    causes: Vec<&'static str>,
    /// Thread or callback that used the time, where it is known.
    by: Vec<ByJson>,
    change: String,
}

/// `why --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Json {
    program: String,
    pid: u32,
    alive: bool,
    late: Vec<LateJson>,
    /// Late callbacks of which the recording does not hold all events any more.
    left_out: usize,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    let mut planner = advice::Planner::new(args.deployment.as_deref())?;
    let program = select(&args.program)?;
    let recorded = recorded(&program);
    let own = || recorded.threads.iter().enumerate().take(recorded.own);
    let ends = own().flat_map(|(_, t)| t.late.iter().map(|l| l.response.to));
    let newest = ends.max().unwrap_or(0);
    let from = newest.saturating_sub(args.last.unwrap_or(newest));
    let all = own().flat_map(|(n, t)| t.late.iter().map(move |late| (n, t, late)));
    let asked: Vec<_> = all.filter(|(_, _, l)| l.response.to >= from).collect();
    let whole = asked
        .iter()
        .filter(|(_, t, l)| l.response.from >= t.complete_from);
    let mut whole: Vec<_> = whole.collect();
    whole.sort_by_key(|(_, _, l)| std::cmp::Reverse(l.response.to));
    whole.truncate(MOST);
    let left_out = asked.len() - whole.len();
    let late = whole.iter().rev();
    let late = late.map(|(n, _, late)| explain(&recorded, *n, late, &mut planner));
    let late = late.collect();
    let json = Json {
        program: program.view.program.clone(),
        pid: program.view.pid,
        alive: program.alive,
        late,
        left_out,
    };
    print(&json);
    files::write_json(args.json.json.as_deref(), "why", &json)
}

fn explain(recorded: &Recorded, n: usize, late: &Late, planner: &mut advice::Planner) -> LateJson {
    let parts: Parts = take_apart(&recorded.threads, n, late);
    let mut sums: BTreeMap<Cause, Nanos> = BTreeMap::new();
    for ((cause, _), time) in parts.iter().filter(|(_, time)| **time > 0) {
        *sums.entry(*cause).or_default() += time;
    }
    let causes = named(&sums, late.deadline);
    let mut by: Vec<ByJson> = Vec::new();
    for ((cause, by_whom), ns) in parts.iter().filter(|(_, time)| **time > 0) {
        if let Some(text) = recorded.by(n, *by_whom) {
            by.push(ByJson {
                cause: cause.name(),
                by: text,
                ns: *ns,
            });
        }
    }
    if sums.contains_key(&Cause::NoBudget) {
        for (handle, ns) in advice::consumers(recorded, n, late) {
            by.push(ByJson {
                cause: Cause::NoBudget.name(),
                by: format!("used by {handle}"),
                ns,
            });
        }
    }
    by.sort_by_key(|b| std::cmp::Reverse(b.ns));
    let response = late.response.to - late.response.from;
    let change = planner.change(recorded, n, late, &causes, &parts);
    LateJson {
        handle: recorded.name(n, late.handle),
        response_ns: response,
        parts: sums.iter().map(|(cause, ns)| (cause.name(), *ns)).collect(),
        worker: recorded
            .threads
            .get(n)
            .map_or_else(String::new, |t| t.facts.name.clone()),
        deadline_ns: late.deadline,
        lateness_ns: response.saturating_sub(late.deadline),
        released_at_ns: late.response.from,
        causes: causes.iter().map(|cause| cause.name()).collect(),
        by,
        change,
    }
}

fn print(json: &Json) {
    let ms = |ns: Nanos| format!("{:.3} ms", ns as f64 / 1e6);
    println!(
        "{} (pid {}, {}): {} late callbacks in the recording.",
        json.program,
        json.pid,
        if json.alive { "running" } else { "ended" },
        json.late.len(),
    );
    if json.left_out > 0 {
        println!(
            "{} more whose events were overwritten in part.",
            json.left_out
        );
    }
    let skipped = json.late.len().saturating_sub(PRINTED);
    if skipped > 0 {
        println!("The last {PRINTED}:");
    }
    for late in json.late.iter().skip(skipped) {
        println!(
            "\n{} of worker {}: {} after its release, {} late; because of {}",
            late.handle,
            late.worker,
            ms(late.response_ns),
            ms(late.lateness_ns),
            late.causes.join(", "),
        );
        let mut parts: Vec<_> = late.parts.iter().collect();
        parts.sort_by_key(|(_, ns)| std::cmp::Reverse(**ns));
        for (cause, ns) in parts {
            println!("  {cause:<14} {:>12}", ms(*ns));
            for by in late.by.iter().filter(|by| by.cause == *cause) {
                println!("    {:<12} {:>12}  {}", "", ms(by.ns), by.by);
            }
        }
        println!("  {}", late.change);
    }
}

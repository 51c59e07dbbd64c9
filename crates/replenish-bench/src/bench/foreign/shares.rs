//! `bench foreign shares`: two foreign programs that work without a pause on one CPU.
//!
//! The first one's share is CPU time by `/proc` over time. Both edges of a window lie a whole
//! number of periods apart, where the first program has used its budget: `/proc` is exact for a
//! thread that does not run, and a tick behind for one that does. Without budget the first program
//! is suspended, so that all of its CPU time is budget.

use super::adopted::Adopted;
use super::options::Options;
use super::program::{Program, Workshop, python};
use crate::load::{MS, Nanos};
use crate::testbench::windows::STOLEN;
use replenish_cli::lock;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::table::{Table, percent_with};
use replenish_os::{SchedClass, clock, steal_time};
use std::path::Path;
use std::process::Command;

const LENGTH: Nanos = 3_000 * MS;
/// The budget in percent: 30 ms in every 100.
const ALLOWED: f64 = 30.0;
/// A reading that is later than this makes the window void.
const LATE: Nanos = 2 * MS;
/// Void windows of a case, at most.
const REPEATS: u32 = 40;

/// One case. Names are a contract.
#[derive(Debug, serde::Serialize)]
struct Case {
    programs: String,
    budget: bool,
    /// The shares of the first and of the second program in each window.
    first_percent: Vec<f64>,
    second_percent: Vec<f64>,
    /// Of the median, without budget none.
    error_percent: Option<f64>,
    repeated: u32,
    enforcer_percent: Option<f64>,
}

/// `bench foreign shares`.
pub(super) fn run(options: &Options) -> Outcome {
    let cpu = options.cpus()?.measured;
    let _alone = lock::acquire()?;
    let workshop = Workshop::new()?;
    let work = workshop.c("work", include_str!("programs/work.c"))?;
    let script = workshop.script("work.py", include_str!("programs/work.py"))?;
    let c = |threads: &str| {
        let mut command = Command::new(&work);
        command.arg(threads);
        command
    };
    let python = || python("python3", Path::new(&script));
    let mut cases = Vec::new();
    for (name, mut first, mut second) in [
        ("C, Python", c("1"), python()),
        ("Python, C", python(), c("1")),
        ("C with 8 threads, Python", c("8"), python()),
    ] {
        let first = Program::start(&mut first, cpu, SchedClass::Other)?;
        let second = Program::start(&mut second, cpu, SchedClass::Other)?;
        let pair = [&first, &second];
        for budget in [false, true] {
            cases.push(measure(options, &workshop, name, pair, cpu, budget)?);
        }
    }
    let mut table = Table::new(&["programs", "budget", "first", "error", "second", "enforcer"]);
    for case in &cases {
        let or = |value: Option<f64>| value.map_or_else(String::new, |v| percent_with(v, 3));
        table.row([
            case.programs.clone(),
            if case.budget { "30 ms/100 ms" } else { "none" }.into(),
            percent_with(median(&case.first_percent), 3),
            or(case.error_percent),
            percent_with(median(&case.second_percent), 1),
            or(case.enforcer_percent),
        ]);
    }
    println!("{}", table.to_text());
    options.write(
        "bench-foreign-shares",
        &serde_json::json!({ "cases": cases }),
    )
}

fn measure(
    options: &Options,
    workshop: &Workshop,
    name: &str,
    pair: [&Program; 2],
    cpu: usize,
    budget: bool,
) -> Result<Case, Failure> {
    let budgets = ["--budget", "30ms/100ms", "--background", "suspend"];
    let first = pair.first().copied().into_iter().collect::<Vec<_>>();
    let adopted = budget.then(|| Adopted::start(workshop, &first, cpu, &budgets));
    let adopted = adopted.transpose()?;
    let mut case = Case {
        programs: name.into(),
        budget,
        first_percent: Vec::new(),
        second_percent: Vec::new(),
        error_percent: None,
        repeated: 0,
        enforcer_percent: None,
    };
    while case.first_percent.len() < options.windows as usize {
        match window(pair, cpu, budget) {
            Some([first, second]) => {
                case.first_percent.push(first);
                case.second_percent.push(second);
            }
            None if case.repeated == REPEATS => {
                return Err(Failure::refused(format!(
                    "{REPEATS} windows in which the machine did not keep up: try again later"
                )));
            }
            None => case.repeated += 1,
        }
    }
    case.error_percent = budget.then(|| median(&case.first_percent) - ALLOWED);
    if let Some(adopted) = adopted {
        let report = adopted.finish()?;
        let time = |name: &str| report.get(name).and_then(serde_json::Value::as_f64);
        let (enforcer, all) = (time("enforcer_ns"), time("elapsed_ns"));
        case.enforcer_percent = enforcer.zip(all).map(|(ns, all)| ns * 100.0 / all);
    }
    Ok(case)
}

/// The shares of one window; `None` if the machine did not keep up.
fn window([first, second]: [&Program; 2], cpu: usize, budget: bool) -> Option<[f64; 2]> {
    if budget {
        stands_still(first)?;
    }
    let stolen = steal_time(cpu);
    let begin = clock::monotonic();
    let before = [first.cpu(""), second.cpu("")];
    clock::sleep_until(begin + LENGTH);
    let end = clock::monotonic();
    let after = [first.cpu(""), second.cpu("")];
    let lost = steal_time(cpu).unwrap_or(0) - stolen.unwrap_or(0);
    let late = clock::monotonic().saturating_sub(begin + LENGTH);
    if late > LATE || lost >= STOLEN {
        return None;
    }
    let share = |(before, after): (Nanos, Nanos)| {
        after.saturating_sub(before) as f64 * 100.0 / end.saturating_sub(begin).max(1) as f64
    };
    let [before1, before2] = before;
    let [after1, after2] = after;
    Some([share((before1, after1)), share((before2, after2))])
}

/// Waits until the program has used its budget: its account stands still.
fn stands_still(program: &Program) -> Option<()> {
    let (mut last, mut same) = (0, 0);
    for _ in 0..200 {
        let now = program.cpu("");
        same = if now == last { same + 1 } else { 0 };
        last = now;
        if same == 5 {
            return Some(());
        }
        clock::sleep_until(clock::monotonic() + 3 * MS);
    }
    None
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

//! `bench foreign trips`: round trips of two genuine rclpy programs, beside a third one whose
//! callback never returns; all on one CPU.
//!
//! | case | the two | the third |
//! |---|---|---|
//! | alone | time-shared | stopped |
//! | alone, budget | 60 ms in every 100 for all of their threads, `dds.*` among them | stopped |
//! | budgets | the same | 10 ms in every 100, below |
//! | time-shared | time-shared | time-shared |
//! | FIFO | FIFO 50 | FIFO 50 |
//!
//! Under FIFO the third one never lets the others run. The bench gives it another class after 2 s,
//! and counts the time until the answer. Every round measures all cases one after another.

use super::adopted::Adopted;
use super::options::Options;
use super::program::{Program, Workshop, python};
use crate::load::{MS, Nanos};
use crate::testbench::windows::STOLEN;
use replenish_cli::lock;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::table::Table;
use replenish_os::{SchedClass, clock, steal_time};
use std::path::PathBuf;

/// Trips of a case in each round.
const TRIPS: u32 = 100;
/// After so long a trip under FIFO is broken off.
const BROKEN_OFF: Nanos = 2_000 * MS;
/// Void rounds at most.
const REPEATS: u32 = 20;
const STOP: i32 = 19;
const GO_ON: i32 = 18;
const CASES: [&str; 5] = ["alone", "alone, budget", "budgets", "time-shared", "FIFO"];

/// Options of `bench foreign trips`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    options: Options,

    /// The Python that has rclpy; crates/replenish-rtps/tests/peers/setup.sh installs those of
    /// Kilted and of Jazzy.
    #[arg(
        long,
        value_name = "FILE",
        default_value = "target/peers/kilted/bin/python"
    )]
    python: PathBuf,
}

/// `bench foreign trips`.
pub(super) fn run(args: &Args) -> Outcome {
    let cpu = args.options.cpus()?.measured;
    let _alone = lock::acquire()?;
    let workshop = Workshop::new()?;
    let start = |name: &str, source: &str| {
        let script = workshop.script(name, source)?;
        let mut command = python(&args.python, &script);
        let domain = 100 + std::process::id() % 100;
        command.env("ROS_DOMAIN_ID", domain.to_string());
        command.env("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4");
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        Program::start(&mut command, cpu, SchedClass::Other)
    };
    let echo = start("echo.py", include_str!("programs/echo.py"))?;
    let mut trips = start("trips.py", include_str!("programs/trips.py"))?;
    let mut stuck = start("stuck.py", include_str!("programs/stuck.py"))?;
    stuck.say("go")?;
    stuck.line()?;
    stuck.signal(STOP);
    trips.ask(TRIPS)?; // imports and caches
    let mut samples: [Vec<i64>; 5] = Default::default();
    let (mut windows, mut repeated) = (0, 0);
    while windows < args.options.windows {
        let stolen = steal_time(cpu).unwrap_or(0);
        let mut round: [Vec<i64>; 5] = Default::default();
        for (case, samples) in CASES.iter().zip(&mut round) {
            *samples = measure(&workshop, cpu, case, &echo, &mut trips, &stuck)?;
        }
        let lost = steal_time(cpu).unwrap_or(0) - stolen;
        if lost >= STOLEN && repeated < REPEATS {
            repeated += 1;
            continue;
        }
        windows += 1;
        for (all, more) in samples.iter_mut().zip(round) {
            all.extend(more);
        }
    }
    let sorted = samples.map(Sorted::new);
    let [alone, kept, ..] = &sorted;
    let (alone, kept) = (alone.percentile(99).max(1), kept.percentile(99).max(1));
    let mut table = Table::new(&[
        "case",
        "trips",
        "median us",
        "p99 us",
        "of alone",
        "of alone, budget",
    ]);
    let mut json = Vec::new();
    for (case, sorted) in CASES.iter().zip(&sorted) {
        let p99 = sorted.percentile(99);
        let ratios = [alone, kept].map(|base| p99 as f64 / base as f64);
        let [of_alone, of_kept] = ratios.map(|ratio| format!("{ratio:.2}"));
        table.row([
            (*case).to_owned(),
            sorted.len().to_string(),
            format!("{:.0}", us(sorted.median())),
            format!("{:.0}", us(p99)),
            of_alone,
            of_kept,
        ]);
        json.push(serde_json::json!({
            "case": case, "trips": sorted.len(), "median_ns": sorted.median(), "p99_ns": p99,
            "ratio_alone": ratios.first(), "ratio_alone_with_budget": ratios.last(),
        }));
    }
    println!("{}", table.to_text());
    let json = serde_json::json!({
        "python": args.python.display().to_string(), "cases": json, "repeated": repeated,
    });
    args.options.write("bench-foreign-trips", &json)
}

fn measure(
    workshop: &Workshop,
    cpu: usize,
    case: &str,
    echo: &Program,
    trips: &mut Program,
    stuck: &Program,
) -> Result<Vec<i64>, Failure> {
    let ours = ["--budget", "60ms/100ms@50"];
    let theirs = ["--budget", "10ms/100ms@20"];
    let budgets = matches!(case, "alone, budget" | "budgets");
    let adopted = budgets.then(|| Adopted::start(workshop, &[echo, trips], cpu, &ours));
    let adopted = adopted.transpose()?;
    let beside = (case == "budgets").then(|| Adopted::start(workshop, &[stuck], cpu, &theirs));
    let beside = beside.transpose()?;
    if !case.starts_with("alone") {
        stuck.signal(GO_ON);
    }
    let samples = match case {
        "FIFO" => starved(echo, trips, stuck),
        _ => trips.ask(TRIPS),
    };
    stuck.signal(STOP);
    for adopted in [adopted, beside].into_iter().flatten() {
        adopted.finish()?;
    }
    samples
}

/// A trip where all three are equals under FIFO, from the request to the answer: the program may
/// not even begin it.
fn starved(echo: &Program, trips: &mut Program, stuck: &Program) -> Result<Vec<i64>, Failure> {
    for program in [echo, trips, stuck] {
        program.set_class(SchedClass::Fifo(50))?;
    }
    let begun = clock::monotonic();
    trips.say("1")?;
    clock::sleep_until(begun + BROKEN_OFF);
    for program in [stuck, echo, trips] {
        program.set_class(SchedClass::Other)?;
    }
    trips.numbers()?;
    let took = clock::monotonic().saturating_sub(begun);
    Ok(vec![i64::try_from(took).unwrap_or(i64::MAX)])
}

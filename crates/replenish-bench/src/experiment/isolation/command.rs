//! Options and windows of the isolation experiment.

use super::super::output::Files;
use super::case::Case;
use super::report;
use super::scenario::{self, Disturbance};
use crate::load::{MS, Nanos};
use crate::options;
use crate::report::progress::Progress;
use crate::testbench::windows::{REPEATS, STOLEN};
use replenish_cli::lock;
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::signals::Stop;
use std::time::Duration;

/// A window in which the machine stood still for longer is repeated.
const STALL: Nanos = 2 * MS;
/// Between two windows: the kernel stops real-time threads that take a CPU for 950 ms of a second.
const PAUSE: Duration = Duration::from_millis(150);

/// Options of `experiment isolation`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Windows of half a second per case.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = options::windows())]
    windows: u64,

    #[command(flatten)]
    files: Files,
}

/// Runs the experiment.
pub(crate) fn run(args: &Args) -> Outcome {
    args.files.check()?;
    let stop = Stop::on_signals()?;
    let _alone = lock::acquire()?;
    let mut progress = Progress::new();
    let plan: Vec<_> = Disturbance::ALL
        .into_iter()
        .flat_map(|d| [(d, false), (d, true)])
        .collect();
    let mut cases = Vec::new();
    for (n, (disturbance, budgets)) in plan.iter().enumerate() {
        let with = if *budgets { "with" } else { "without" };
        let name = format!("{}, {with} budgets", disturbance.name());
        progress.step(n, plan.len(), &name);
        let case = measure(*disturbance, *budgets, args.windows, &stop);
        cases.push(case.map_err(|e| e.context(&name))?);
    }
    progress.step(plan.len(), plan.len(), "done");
    drop(progress);
    report::write(&args.files, &cases)
}

/// Offers windows until enough of them count; at most twice as many as wanted, or [`REPEATS`] more.
fn measure(
    disturbance: Disturbance,
    budgets: bool,
    wanted: u64,
    stop: &Stop,
) -> Result<Case, Failure> {
    let cpus = Cpus::choose();
    let mut case = Case {
        disturbance,
        budgets,
        responses: Vec::new(),
        windows: 0,
        windows_repeated: 0,
        windows_stalled: 0,
        sent: 0,
        deferred: false,
        fallbacks: Vec::new(),
    };
    while case.windows < wanted {
        if stop.wait(PAUSE) {
            return Err(Failure::refused("interrupted"));
        }
        let window = scenario::run(disturbance, budgets, cpus.measured, cpus.support)?;
        case.deferred |= window.deferred;
        case.fallbacks = window.fallbacks;
        // Without real-time priority the probe is delayed by the workers themselves.
        let late = window.stall > STALL && !case.deferred;
        let stalled = late || window.stolen >= STOLEN;
        if stalled && case.windows_repeated < wanted.max(REPEATS) {
            case.windows_repeated += 1;
            continue;
        }
        case.windows += 1;
        case.windows_stalled += u64::from(stalled);
        case.sent += window.sent;
        case.responses.extend(window.responses);
    }
    Ok(case)
}

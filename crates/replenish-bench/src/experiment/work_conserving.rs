//! `replenish experiment work-conserving`: the paper's Experiment 2.

use super::output::Files;
use super::sleep_report::{self, SleepPoint};
use crate::load::spec::Spec;
use crate::options;
use crate::report::progress::Progress;
use crate::testbench::measured::{Measured, Point};
use crate::testbench::orchestrator::{self, Plan};
use replenish_cli::lock;
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::outcome::Outcome;
use replenish_cli::signals::Stop;

/// Options of `experiment work-conserving`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Part of each 10 ms that the low callback sleeps, in percent.
    #[arg(long, value_name = "PERCENT,…", value_delimiter = ',',
          default_value = "0,10,25,50,75,90,100",
          value_parser = clap::value_parser!(u8).range(0..=100))]
    sleep: Vec<u8>,

    /// Windows of load per point.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = options::windows())]
    windows: u64,

    /// Refuse to run if budgets cannot be enforced in the middle of a callback.
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    files: Files,
}

/// Runs the experiment.
pub(crate) fn run(args: &Args) -> Outcome {
    args.files.check()?;
    if let Some(path) = &args.files.measured {
        let measured = Measured::read(path)?.points;
        let point = |p: &Point| {
            let run = p.run(&Spec::work_conserving(p.sleep_percent))?;
            Ok(SleepPoint::new(p.sleep_percent, &run))
        };
        let points = measured.iter().map(point).collect::<Result<Vec<_>, _>>()?;
        return sleep_report::sleep(&args.files, &points);
    }
    let stop = Stop::on_signals()?;
    let _alone = lock::acquire()?;
    let mut progress = Progress::new();
    let mut points = Vec::new();
    for (n, sleep) in args.sleep.iter().enumerate() {
        let name = format!("low sleeps {sleep} %");
        progress.step(n, args.sleep.len(), &name);
        let plan = Plan {
            spec: Spec::work_conserving(*sleep),
            windows: args.windows,
            continuous: false,
            strict: args.strict,
            cpus: Cpus::choose(),
        };
        let run = orchestrator::run(&plan, &stop, &mut |_| ()).map_err(|e| e.context(&name))?;
        points.push(SleepPoint::new(*sleep, &run));
    }
    progress.step(args.sleep.len(), args.sleep.len(), "done");
    drop(progress);
    sleep_report::sleep(&args.files, &points)
}

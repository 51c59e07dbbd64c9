//! `replenish experiment budget-sweep`: the paper's Experiment 1.

use super::output::Files;
use super::sweep_report::{self, SweepPoint};
use crate::load::spec::Spec;
use crate::options;
use crate::report::progress::Progress;
use crate::testbench::measured::Measured;
use crate::testbench::orchestrator::{self, Plan};
use replenish_cli::lock;
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::signals::Stop;

/// Options of `experiment budget-sweep`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Budgets of the high worker in milliseconds, each at most the period.
    #[arg(long, value_name = "MS,MS,…", value_delimiter = ',',
          default_value = "10,20,30,40,50,60,70,80,90", value_parser = options::budget())]
    budgets: Vec<u64>,

    /// Period of the budget in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = options::period())]
    period: u64,

    /// Windows of load per budget.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = options::windows())]
    windows: u64,

    /// Leave out the case of two FIFO workers.
    #[arg(long)]
    no_fifo: bool,

    /// Refuse to run if budgets cannot be enforced in the middle of a callback.
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    files: Files,
}

/// Runs the experiment.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(too_much) = args.budgets.iter().find(|b| **b > args.period) {
        let allowed = format!("1..={} (the period)", args.period);
        return Err(Failure::range("--budgets", too_much, allowed));
    }
    args.files.check()?;
    if let Some(path) = &args.files.measured {
        let (mut points, mut fifo) = (Vec::new(), None);
        let period = options::ms(args.period);
        for p in Measured::read(path)?.points {
            let spec = match p.budget_ms {
                Some(budget) => Spec::paper(options::ms(budget), period),
                None => Spec::fifo(period),
            };
            let point = SweepPoint::new(p.budget_ms, args.period, &p.run(&spec)?);
            match p.budget_ms {
                Some(_) => points.push(point),
                None => fifo = Some(point),
            }
        }
        return sweep_report::sweep(&args.files, args.period, &points, fifo.as_ref());
    }
    let stop = Stop::on_signals()?;
    let cases = args
        .budgets
        .iter()
        .map(|b| Some(*b))
        .chain((!args.no_fifo).then_some(None))
        .collect::<Vec<_>>();
    let _alone = lock::acquire()?;
    let mut progress = Progress::new();
    let mut points = Vec::new();
    let mut fifo = None;
    for (n, budget) in cases.iter().enumerate() {
        let name = budget.map_or_else(|| "both FIFO".to_string(), |b| format!("budget {b} ms"));
        progress.step(n, cases.len(), &name);
        let period = options::ms(args.period);
        let spec = match budget {
            Some(b) => Spec::paper(options::ms(*b), period),
            None => Spec::fifo(period),
        };
        let plan = Plan {
            spec,
            windows: args.windows,
            continuous: false,
            strict: args.strict,
            cpus: Cpus::choose(),
        };
        let run = orchestrator::run(&plan, &stop, &mut |_| ()).map_err(|e| e.context(&name))?;
        let point = SweepPoint::new(*budget, args.period, &run);
        match budget {
            Some(_) => points.push(point),
            None => fifo = Some(point),
        }
    }
    progress.step(cases.len(), cases.len(), "done");
    drop(progress);
    sweep_report::sweep(&args.files, args.period, &points, fifo.as_ref())
}

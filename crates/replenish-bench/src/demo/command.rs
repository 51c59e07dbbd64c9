//! `replenish demo`: the paper's load on this machine, in ten seconds.

use super::report;
use crate::load::spec::Spec;
use crate::load::{MS, SEC};
use crate::report::progress::Progress;
use crate::roles::protocol::Mode;
use crate::testbench::orchestrator::{self, Plan};
use crate::testbench::windows::Collector;
use replenish_cli::lock;
use replenish_cli::machine;
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::signals::Stop;
use std::path::PathBuf;

/// The budget of the high worker.
const BUDGET: u64 = 30 * MS;
/// Its period.
const PERIOD: u64 = 100 * MS;

/// Options of `demo`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Duration of the load in seconds, pauses included.
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=600))]
    seconds: u64,

    /// Offer the load without pauses: shows what the kernel's RT throttle takes.
    #[arg(long)]
    continuous: bool,

    /// Refuse to run if budgets cannot be enforced in the middle of a callback.
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    json: JsonOption,

    /// The file of the report.
    #[arg(long, value_name = "PATH", default_value = "report.html")]
    report: PathBuf,
}

/// Runs the demo.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    files::check_writable(Some(&args.report))?;
    let stop = Stop::on_signals()?;
    let privilege = machine::privilege();
    if args.strict && !privilege.real_time() {
        return Err(Failure::refused(format!("--strict: {privilege}")));
    }
    let plan = plan(args);
    println!("{}", introduction(&plan));
    let _alone = lock::acquire()?;
    let mut progress = Progress::new();
    let outcome = orchestrator::run(&plan, &stop, &mut |c| show(&mut progress, &plan, c));
    progress.clear();
    let run = outcome.map_err(|e| e.context("demo"))?;

    print!("{}", report::text(&plan, &run));
    if run.mode == Mode::Deferred {
        println!(
            "\nNot guaranteed here: {}",
            report::not_guaranteed(privilege)
        );
    }
    files::write(&args.report, &report::html(&plan, &run, privilege)?)?;
    files::write_json(
        args.json.json.as_deref(),
        "demo",
        &report::json(&plan, &run),
    )?;
    let path = std::path::absolute(&args.report).unwrap_or_else(|_| args.report.clone());
    println!("\nThe plots and what they mean: {}", path.display());
    Ok(())
}

fn plan(args: &Args) -> Plan {
    // 0.4 s of load and 0.1 s of pause make two windows a second.
    let windows = if args.continuous {
        args.seconds
    } else {
        args.seconds * SEC / (500 * MS)
    };
    Plan {
        spec: Spec::paper(BUDGET, PERIOD),
        windows,
        continuous: args.continuous,
        strict: args.strict,
        cpus: Cpus::choose(),
    }
}

fn introduction(plan: &Plan) -> String {
    let cpus = if plan.cpus.is_single() {
        format!(
            "There is one CPU only ({}): ping and agent disturb pong.",
            plan.cpus.measured
        )
    } else {
        format!(
            "Pong's threads run on CPU {}, ping and agent on CPU {}.",
            plan.cpus.measured, plan.cpus.support
        )
    };
    format!(
        "Two topics send a message every 10 ms each; answering one takes 10 ms of CPU time.\n\
         That is twice what one CPU has. The worker of topic `high` has a budget of 30 ms per\n\
         100 ms at high priority, so it must get 30 % and topic `low` the other 70 %.\n{cpus}"
    )
}

fn show(progress: &mut Progress, plan: &Plan, collector: &Collector) {
    let done = collector.counted().len();
    let total = usize::try_from(plan.windows).unwrap_or(usize::MAX);
    let answers = collector.counted().iter().fold((0, 0), |(h, l), w| {
        (h + w.ping.received_high, l + w.ping.received_low)
    });
    let repeated = match collector.repeated() {
        r if r.total() == 0 => String::new(),
        r => format!(", {} windows repeated ({r})", r.total()),
    };
    let text = format!("answers: high {}, low {}{repeated}", answers.0, answers.1);
    progress.step(done, total, &text);
}

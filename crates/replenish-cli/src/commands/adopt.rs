//! `replenish adopt`: budgets for the threads of programs that run already.

use super::foreign::control;
use super::foreign::options::Options;
use super::foreign::selection::Selection;
use super::foreign::supervisor::{PAUSE, Supervisor};
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::report::table::Table;
use crate::signals::Stop;
use replenish_os::Tid;
use std::time::{Duration, Instant};

/// Options of `adopt`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Ends when the programs end, after --seconds, by a signal or by --release; \
                        every thread then has what it had. So it is, within a second, if this \
                        command is killed."
)]
pub struct Args {
    /// The processes, with all that they have started. Without any: those that fit the
    /// deployment file's program.
    #[arg(value_name = "PID", required_unless_present_any = ["list", "release", "deployment"],
          value_parser = clap::value_parser!(u32).range(1..))]
    pids: Vec<u32>,

    /// Show the programs that have budgets by `run` and `adopt`.
    #[arg(long, conflicts_with_all = ["pids", "release"])]
    list: bool,

    /// Give this process back what it had.
    #[arg(long, value_name = "PID", conflicts_with = "pids",
          value_parser = clap::value_parser!(u32).range(1..))]
    release: Option<u32>,

    #[command(flatten)]
    options: Options,
}

/// Adopts, lists or releases.
pub(crate) fn run(args: &Args) -> Outcome {
    let json = args.options.json.json.as_deref();
    files::check_writable(json)?;
    if args.list {
        return list(args);
    }
    let stop = Stop::on_signals()?;
    if let Some(pid) = args.release {
        return control::release(pid, &stop);
    }
    let numbers = args.pids.iter().map(|pid| {
        let number = i32::try_from(*pid).ok().and_then(Tid::new);
        number.ok_or_else(|| Failure::range("PID", pid, format!("1 to {}", i32::MAX)))
    });
    let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
    let (selection, pids) = Selection::for_processes(&args.options, &numbers)?;
    let there = control::list();
    for pid in &pids {
        if let Some(program) = there.iter().find(|program| program.pid == pid.get()) {
            return Err(Failure::refused(format!(
                "process {pid} has budgets by supervisor {}: `replenish adopt --release {pid}` \
                 ends them",
                program.supervisor
            )));
        }
    }
    let mut supervisor = Supervisor::start(&selection, args.options.background)?;
    let outcome = supervise(&mut supervisor, args, &pids, &stop);
    let report = supervisor.finish()?;
    outcome?;
    report.finish(json)
}

fn supervise(supervisor: &mut Supervisor, args: &Args, pids: &[Tid], stop: &Stop) -> Outcome {
    for pid in pids {
        supervisor.adopt(*pid)?;
    }
    remark!(
        "adopted on CPU {}; guardian: process {}",
        supervisor.cpu(),
        supervisor.guardian()
    );
    let seconds = args.options.seconds.map(Duration::from_secs);
    let end = seconds.map(|seconds| Instant::now() + seconds);
    while supervisor.look()? && end.is_none_or(|end| Instant::now() < end) {
        if stop.wait(PAUSE) {
            break;
        }
    }
    Ok(())
}

fn list(args: &Args) -> Outcome {
    let programs = control::list();
    let mut table = Table::new(&["pid", "program", "threads", "budgets", "supervisor"]);
    for program in &programs {
        table.row([
            program.pid.to_string(),
            program.name.clone(),
            program.threads.to_string(),
            program.budgets.clone(),
            program.supervisor.to_string(),
        ]);
    }
    println!("{}", table.to_text());
    let json = serde_json::json!({ "programs": programs });
    files::write_json(args.options.json.json.as_deref(), "programs", &json)
}

//! `replenish run`: a program with budgets for its threads, from its first instruction to its end.

use super::foreign::options::Options;
use super::foreign::selection::Selection;
use super::foreign::supervisor::{PAUSE, Supervisor};
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use replenish_os::foreign::Process;
use replenish_os::{CpuSet, Tid, affinity, current_tid, set_affinity};
use signal_hook::consts::{SIGHUP, SIGINT, SIGKILL, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2};
use signal_hook::iterator::Signals;
use std::io::IsTerminal;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, ExitStatus};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time that a program has to end after it was asked to.
const WIND_DOWN: Duration = Duration::from_secs(2);

/// Options of `run`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "The program needs no change. `docs/foreign-programs.md` says what holds, \
                        and what does not."
)]
pub struct Args {
    #[command(flatten)]
    options: Options,

    /// The program to start, and its arguments.
    #[arg(last = true, value_name = "PROGRAM", required = true)]
    program: Vec<String>,
}

/// Starts it, looks after it, reports, and ends as it did.
pub(crate) fn run(args: &Args) -> Outcome {
    let options = &args.options;
    let json = options.json.json.as_deref();
    files::check_writable(json)?;
    let selection = Selection::for_command(options, &args.program)?;
    let mut supervisor = Supervisor::start(&selection, options.background)?;
    // Before there is a program that one could be meant for.
    let signals = [SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGUSR2];
    let signals = Signals::new(signals)
        .map_err(|e| Failure::refused(format!("cannot handle signals: {e}")))?;
    let mut program = start(args, options.cpu.is_some().then(|| supervisor.cpu()))?;
    let status = supervise(&mut supervisor, &mut program, signals, options.seconds);
    if status.is_err() {
        program.kill().ok(); // without its budgets it is not what was asked for
        program.wait().ok();
    }
    let report = supervisor.finish()?;
    let status = status?;
    report.finish(json)?;
    match code(status) {
        0 => Ok(()),
        code => Err(Failure::Program(code)),
    }
}

/// Starts the program, on `cpu` if there is one: it inherits that from this thread.
fn start(args: &Args, cpu: Option<usize>) -> Result<Child, Failure> {
    let (name, arguments) = args
        .program
        .split_first()
        .ok_or_else(|| Failure::Usage("a program is needed".into()))?;
    let here = affinity(current_tid()).map_err(Failure::refused)?;
    if let Some(cpu) = cpu {
        set_affinity(current_tid(), &CpuSet::one(cpu)).map_err(Failure::refused)?;
    }
    let started = Command::new(name).args(arguments).spawn();
    set_affinity(current_tid(), &here).map_err(Failure::refused)?;
    started.map_err(|e| Failure::refused(format!("cannot start {name}: {e}")))
}

fn supervise(
    supervisor: &mut Supervisor,
    program: &mut Child,
    mut signals: Signals,
    seconds: Option<u64>,
) -> Result<ExitStatus, Failure> {
    let pid = Tid::new(program.id().cast_signed())
        .ok_or_else(|| Failure::refused("the program has no number"))?;
    let process = Arc::new(Process::open(pid).map_err(Failure::refused)?);
    let theirs = Arc::clone(&process);
    std::thread::spawn(move || {
        // The terminal itself tells all of its programs of these.
        let terminal = std::io::stdin().is_terminal();
        for signal in signals.forever() {
            if !(terminal && matches!(signal, SIGINT | SIGQUIT)) {
                theirs.signal(signal).ok(); // it has ended
            }
        }
    });
    let adopted = supervisor.adopt(pid);
    if let Some(status) = program.try_wait().map_err(Failure::refused)? {
        return Ok(status); // too short to get anything
    }
    adopted?;
    let end = seconds.map(|seconds| Instant::now() + Duration::from_secs(seconds));
    let mut asked = None;
    loop {
        if let Some(status) = program.try_wait().map_err(Failure::refused)? {
            return Ok(status);
        }
        supervisor.look()?;
        let now = Instant::now();
        if end.is_some_and(|end| now >= end) {
            match asked {
                None => {
                    process.signal(SIGTERM).ok(); // it has ended: seen in the next round
                    asked = Some(now);
                }
                Some(since) if now >= since + WIND_DOWN => drop(process.signal(SIGKILL)),
                Some(_) => {}
            }
        }
        std::thread::sleep(PAUSE);
    }
}

/// The exit code as a shell gives it.
fn code(status: ExitStatus) -> u8 {
    let signal = status.signal().map(|signal| 128 + signal);
    let code = status.code().or(signal).unwrap_or(1);
    u8::try_from(code).unwrap_or(1)
}

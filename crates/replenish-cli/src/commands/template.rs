//! `replenish template -- PROGRAM`: the deployment file of a program as it describes itself.
//!
//! The program runs up to the start of its executor, writes what it would start to the file that
//! `REPLENISH_TEMPLATE` names, and does not start.

use crate::outcome::{Failure, Outcome};
use crate::report::files;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// How long a program may take until its executor would start.
const LIMIT: Duration = Duration::from_secs(60);
/// Between two looks at it.
const LOOK: Duration = Duration::from_millis(20);

/// Options of `template`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where to write it, instead of standard output.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,

    /// The program, and its arguments.
    #[arg(last = true, value_name = "PROGRAM", required = true)]
    program: Vec<String>,
}

/// Asks the program.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.out.as_deref())?;
    let name = format!("replenish-template-{}.toml", std::process::id());
    let path = std::env::temp_dir().join(name);
    let template = ask(&args.program, &path);
    std::fs::remove_file(&path).ok();
    let template = template?;
    match &args.out {
        Some(out) => files::write(out, &template),
        None => {
            print!("{template}");
            Ok(())
        }
    }
}

fn ask(program: &[String], path: &std::path::Path) -> Result<String, Failure> {
    let (program, arguments) = program
        .split_first()
        .ok_or_else(|| Failure::Usage("a program is needed".into()))?;
    let mut child = Command::new(program)
        .args(arguments)
        .env("REPLENISH_TEMPLATE", path)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| Failure::refused(format!("cannot start {program}: {e}")))?;
    let end = Instant::now() + LIMIT;
    while matches!(child.try_wait(), Ok(None)) {
        if Instant::now() > end {
            child.kill().ok();
        }
        std::thread::sleep(LOOK);
    }
    let output = child.wait_with_output().map_err(Failure::refused)?;
    std::fs::read_to_string(path).map_err(|_| {
        let said = String::from_utf8_lossy(&output.stderr);
        Failure::refused(format!(
            "{program} ended ({}) before an executor of replenish would have started; its last words: {}",
            output.status,
            said.lines().last().unwrap_or("none")
        ))
    })
}

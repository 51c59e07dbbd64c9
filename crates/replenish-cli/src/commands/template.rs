//! `replenish template -- PROGRAM`: the deployment file of a program as it describes itself.
//!
//! The program runs up to the start of its executor, writes what it would start to the file that
//! `REPLENISH_TEMPLATE` names, and does not start.

use crate::outcome::{Failure, Outcome};
use crate::report::files;
use std::fs::{DirBuilder, File};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The longest time until the program's executor would start.
const LIMIT: Duration = Duration::from_secs(60);
/// Pause between two looks at the program.
const LOOK: Duration = Duration::from_millis(20);

/// Options of `template`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The file to write, instead of standard output.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,

    /// The program, and its arguments.
    #[arg(last = true, value_name = "PROGRAM", required = true)]
    program: Vec<String>,
}

/// Asks the program.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.out.as_deref())?;
    // A directory of our own: a link that another account left in a shared one would be followed.
    let name = format!("replenish-template-{}", std::process::id());
    let directory = std::env::temp_dir().join(name);
    let private = |e| Failure::refused(format!("cannot make {}: {e}", directory.display()));
    DirBuilder::new()
        .mode(0o700)
        .create(&directory)
        .map_err(private)?;
    let template = ask(&args.program, &directory);
    std::fs::remove_dir_all(&directory).ok();
    let template = template?;
    match &args.out {
        Some(out) => files::write(out, &template),
        None => {
            print!("{template}");
            Ok(())
        }
    }
}

fn ask(program: &[String], directory: &Path) -> Result<String, Failure> {
    let (template, words) = (directory.join("template.toml"), directory.join("words"));
    let heard = File::create(&words).map_err(Failure::refused)?; // a pipe would fill
    let (program, arguments) = program
        .split_first()
        .ok_or_else(|| Failure::Usage("a program is needed".into()))?;
    let mut child = Command::new(program)
        .args(arguments)
        .env("REPLENISH_TEMPLATE", &template)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(heard)
        .spawn()
        .map_err(|e| Failure::refused(format!("cannot start {program}: {e}")))?;
    let end = Instant::now() + LIMIT;
    while matches!(child.try_wait(), Ok(None)) {
        if Instant::now() > end {
            child.kill().ok();
        }
        std::thread::sleep(LOOK);
    }
    let status = child.wait().map_err(Failure::refused)?;
    std::fs::read_to_string(template).map_err(|_| {
        let said = std::fs::read(&words).unwrap_or_default();
        let said = String::from_utf8_lossy(&said);
        Failure::refused(format!(
            "{program} ended ({status}) before an executor of replenish would have started; its last words: {}",
            said.lines().last().unwrap_or("none")
        ))
    })
}

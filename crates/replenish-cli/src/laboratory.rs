//! The laboratory: words of the command that stand in a program of their own, `replenish-bench`.
//!
//! It is not published, and a robot does not need it. `replenish demo` becomes `replenish-bench
//! demo`, as `git` and `cargo` do with words that others add.

use crate::outcome::{Failure, Outcome};
use std::ffi::OsString;
use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

/// The program.
const PROGRAM: &str = "replenish-bench";

/// The laboratory's words.
const WORDS: [&str; 5] = ["demo", "experiment", "bench", "ping", "pong"];

/// The last lines of `replenish --help`.
pub const HELP: &str = "The laboratory (demo, experiment, bench, ping, pong) is the program \
    replenish-bench:\nthese words run it if it stands beside this program or in PATH; in a clone: \
    cargo run --release -- demo\n\
    Exit codes: 0 done, 1 could not be done (the reason is printed), 2 wrong command line.";

/// A command line for the laboratory.
#[derive(Debug)]
pub struct Laboratory(Vec<OsString>);

/// This process's command line, if its first word is one of the laboratory's.
#[must_use]
pub fn asked() -> Option<Laboratory> {
    let line: Vec<OsString> = std::env::args_os().skip(1).collect();
    let word = line.first()?.to_str()?;
    WORDS.contains(&word).then_some(Laboratory(line))
}

impl Laboratory {
    /// Becomes that program; returns only if there is none.
    ///
    /// # Errors
    /// A refusal that says how to get it.
    pub fn run(self) -> Outcome {
        let why = match self.exec(beside()) {
            why if why.kind() == ErrorKind::NotFound => self.exec(PathBuf::from(PROGRAM)),
            why => why,
        };
        let word = self.0.first().map(|w| w.display().to_string());
        Err(Failure::refused(format!(
            "{} is a word of the laboratory, and {PROGRAM} cannot be started: {why}. It comes with a \
             clone of the sources: cargo install --path crates/{PROGRAM}",
            word.unwrap_or_default()
        )))
    }

    fn exec(&self, program: PathBuf) -> std::io::Error {
        Command::new(program).args(&self.0).exec()
    }
}

/// The laboratory's path if both programs are installed in one directory.
fn beside() -> PathBuf {
    let own = std::env::current_exe().unwrap_or_default();
    own.with_file_name(PROGRAM)
}

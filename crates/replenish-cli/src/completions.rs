//! `replenish completions SHELL`: what a shell completes behind `replenish`.

use crate::outcome::{Failure, Outcome};
use std::io::{ErrorKind, Write as _};

/// Options of `completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The shell.
    #[arg(value_name = "SHELL")]
    shell: clap_complete::Shell,
}

/// Prints the completions of `command`.
///
/// # Errors
/// Standard output cannot be written.
pub(crate) fn run(args: &Args, mut command: clap::Command) -> Outcome {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "replenish", &mut text);
    written(&text)
}

/// Writes to standard output; a reader that has gone (`| head`) ends the program.
pub(crate) fn written(text: &[u8]) -> Outcome {
    let mut output = std::io::stdout();
    match output.write_all(text).and_then(|()| output.flush()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => crate::print::reader_gone(),
        outcome => outcome.map_err(|e| Failure::refused(format!("cannot write the output: {e}"))),
    }
}

//! `replenish man`: the manual page, made of the same text as `--help`.

use crate::completions::written;
use crate::outcome::{Failure, Outcome};
use std::path::PathBuf;

/// Options of `man`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Write replenish.1 and a page of each command (replenish-agent.1 …) into this directory.
    #[arg(long, value_name = "PATH")]
    dir: Option<PathBuf>,
}

/// Prints the page of `command`, or writes all pages.
///
/// # Errors
/// The output cannot be written.
pub(crate) fn run(args: &Args, command: clap::Command) -> Outcome {
    let Some(dir) = &args.dir else {
        let mut page = Vec::new();
        let rendered = clap_mangen::Man::new(command).render(&mut page);
        rendered.map_err(Failure::refused)?;
        return written(&page);
    };
    let failed = |e| Failure::refused(format!("cannot write into {}: {e}", dir.display()));
    std::fs::create_dir_all(dir).map_err(failed)?;
    clap_mangen::generate_to(command, dir).map_err(failed)
}

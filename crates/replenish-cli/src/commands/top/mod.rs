//! `replenish top`: every program of this host with its workers, from their recordings.
//!
//! ```text
//!   files of programs ─► once: table, JSON
//!                     └► reading: what has happened since the look before ◄─ machine: /proc
//!                          └► screen │ detail ─► canvas ─► terminal, or a picture
//!   keys ─► state: order, selection            interactive: the loop around them
//! ```

mod canvas;
mod detail;
mod interactive;
mod machine;
mod once;
mod reading;
mod screen;
mod state;

use crate::options::JsonOption;
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use replenish_os::Terminal;
use std::path::PathBuf;
use std::time::Duration;

/// Options of `top`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Print the table once and end.
    #[arg(long)]
    once: bool,

    /// Programs that were killed or have crashed, too.
    #[arg(long)]
    ended: bool,

    /// Between two looks: 1s, 500ms.
    #[arg(long, value_name = "TIME", value_parser = crate::options::last, default_value = "1s",
          conflicts_with = "once")]
    every: crate::time::Nanos,

    /// Look twice, draw the screen into this file as a picture, and end.
    #[arg(long, value_name = "OUT.svg", conflicts_with = "once")]
    svg: Option<PathBuf>,

    /// With `--svg`: this worker alone, with its histogram and its last second.
    #[arg(long, value_name = "WORKER", requires = "svg")]
    worker: Option<String>,

    /// Columns of the picture.
    #[arg(long, value_name = "N", requires = "svg", default_value_t = 150,
          value_parser = clap::value_parser!(u16).range(20..=400))]
    columns: u16,

    #[command(flatten)]
    json: JsonOption,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if args.once {
        files::check_writable(args.json.json.as_deref())?;
        let json = once::Json::look(args.ended);
        once::print(&json);
        return files::write_json(args.json.json.as_deref(), "top", &json);
    }
    if args.json.json.is_some() {
        return Err(Failure::Usage("--json is allowed with --once only".into()));
    }
    let every = Duration::from_nanos(args.every);
    if !(Duration::from_millis(100)..=Duration::from_secs(60)).contains(&every) {
        return Err(Failure::range(
            "--every",
            format!("{every:?}"),
            "100ms to 60s",
        ));
    }
    if let Some(out) = &args.svg {
        files::check_writable(Some(out))?;
        let worker = args.worker.as_deref();
        return interactive::picture(out, worker, every, args.ended, args.columns.into());
    }
    if !Terminal::is_there() {
        let why = "--once is needed where standard input or output is no terminal";
        return Err(Failure::Usage(why.into()));
    }
    interactive::run(every, args.ended)
}

//! `-q` and `-v`: how much a command says on standard error besides its errors.
//!
//! Results go to standard output, and errors to standard error, whatever is asked for.

use std::sync::atomic::{AtomicU8, Ordering};

/// Options of every command.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct Verbosity {
    /// Say more on standard error: where it looked, and how long it took.
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    verbose: bool,

    /// Say nothing on standard error but errors.
    #[arg(short, long, global = true)]
    quiet: bool,
}

const QUIET: u8 = 0;
const ORDINARY: u8 = 1;
const VERBOSE: u8 = 2;

/// The level of this process, written once at its start.
static LEVEL: AtomicU8 = AtomicU8::new(ORDINARY);

impl Verbosity {
    /// Holds from now on.
    pub fn apply(self) {
        let level = match self {
            Self { quiet: true, .. } => QUIET,
            Self { verbose: true, .. } => VERBOSE,
            _ => ORDINARY,
        };
        LEVEL.store(level, Ordering::Relaxed);
    }
}

/// Whether remarks are printed.
pub fn remarks() -> bool {
    LEVEL.load(Ordering::Relaxed) >= ORDINARY
}

/// Whether details are printed.
pub fn details() -> bool {
    LEVEL.load(Ordering::Relaxed) >= VERBOSE
}

/// A line on standard error, unless `-q` is given.
#[macro_export]
macro_rules! remark {
    ($($text:tt)*) => {
        if $crate::verbosity::remarks() {
            $crate::print::err(format_args!("{}\n", format_args!($($text)*)));
        }
    };
}

/// A line on standard error if `-v` is given.
#[macro_export]
macro_rules! detail {
    ($($text:tt)*) => {
        if $crate::verbosity::details() {
            $crate::print::err(format_args!("{}\n", format_args!($($text)*)));
        }
    };
}

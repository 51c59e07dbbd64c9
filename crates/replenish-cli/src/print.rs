//! `println!` and its kin for programs at the end of which somebody may stop reading: they stand in
//! the place of the standard library's, which panic then.
//!
//! A reader that has gone (`| head`) ends the program without a word, with the status that a shell
//! sees of `cat` or `yes` in its place; on a disk that is full it says so and fails. `xtask` has the
//! same file.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};

/// What a shell sees of a program that SIGPIPE (13) has ended.
const READER_GONE: i32 = 128 + 13;

/// Writes to standard output, or ends the program.
pub(crate) fn out(text: Arguments<'_>) {
    written(io::stdout().write_fmt(text));
}

/// Writes to standard error, or ends the program.
pub(crate) fn err(text: Arguments<'_>) {
    written(io::stderr().write_fmt(text));
}

fn written(outcome: io::Result<()>) {
    let Err(why) = outcome else { return };
    if why.kind() == ErrorKind::BrokenPipe {
        std::process::exit(READER_GONE);
    }
    // If this is what cannot be written, there is nobody left to tell.
    writeln!(io::stderr(), "cannot write what was to be said: {why}").ok();
    std::process::exit(1);
}

macro_rules! print {
    ($($said:tt)*) => { $crate::print::out(format_args!($($said)*)) };
}

macro_rules! println {
    ($($said:tt)*) => { print!("{}\n", format_args!($($said)*)) };
}

#[allow(unused_macros, reason = "xtask has the same file, and draws no bars")]
macro_rules! eprint {
    ($($said:tt)*) => { $crate::print::err(format_args!($($said)*)) };
}

macro_rules! eprintln {
    ($($said:tt)*) => { $crate::print::err(format_args!("{}\n", format_args!($($said)*))) };
}

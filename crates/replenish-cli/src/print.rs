//! `println!` and its kin for programs whose reader may stop reading: the standard library's panic.
//!
//! A reader that has gone (`| head`) ends the program silently, with the status that a shell sees
//! of `cat` or `yes` in its place. A full disk ends it with a message and status 1. `xtask` mounts
//! this file as well.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};

/// The exit status that a shell sees of a program that SIGPIPE (13) has ended.
const READER_GONE: i32 = 128 + 13;

/// Writes to standard output, or ends the program.
pub fn out(text: Arguments<'_>) {
    written(io::stdout().write_fmt(text));
}

/// Writes to standard error, or ends the program.
pub fn err(text: Arguments<'_>) {
    written(io::stderr().write_fmt(text));
}

/// Ends the program as a shell expects it of one whose reader has gone.
pub fn reader_gone() -> ! {
    std::process::exit(READER_GONE)
}

fn written(outcome: io::Result<()>) {
    let Err(why) = outcome else { return };
    if why.kind() == ErrorKind::BrokenPipe {
        reader_gone();
    }
    // If standard error fails as well, no reader is left.
    writeln!(io::stderr(), "cannot write the output: {why}").ok();
    std::process::exit(1);
}

/// `print!` that ends the program if its reader has gone.
#[macro_export]
macro_rules! print {
    ($($text:tt)*) => { $crate::print::out(format_args!($($text)*)) };
}

/// `println!` that ends the program if its reader has gone.
#[macro_export]
macro_rules! println {
    ($($text:tt)*) => { $crate::print::out(format_args!("{}\n", format_args!($($text)*))) };
}

/// `eprint!` that ends the program if its reader has gone.
#[macro_export]
macro_rules! eprint {
    ($($text:tt)*) => { $crate::print::err(format_args!($($text)*)) };
}

/// `eprintln!` that ends the program if its reader has gone.
#[macro_export]
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::print::err(format_args!("{}\n", format_args!($($text)*))) };
}

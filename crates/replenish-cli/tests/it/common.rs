//! The built command of this crate.
#![allow(clippy::unwrap_used, reason = "a helper of tests")]

pub(crate) use replenish_testkit::program::{Scratch, stderr, stdout};
use std::path::Path;
use std::process::Output;

/// The command under test.
pub(crate) const BIN: &str = env!("CARGO_BIN_EXE_replenish");

/// Runs it to its end.
pub(crate) fn run(args: &[&str]) -> Output {
    replenish_testkit::program::run(BIN, args)
}

/// A JSON file of a command, held to its schema.
pub(crate) fn json(path: &Path) -> serde_json::Value {
    crate::schema::read(path)
}

//! The built command of this crate.
#![allow(
    dead_code,
    unused_imports,
    clippy::unwrap_used,
    reason = "a helper of tests, shared by several targets"
)]

#[path = "../../../replenish-cli/tests/it/schema.rs"]
mod schema;

pub(crate) use replenish_testkit::program::{Running, Scratch, free_port, stderr, stdout};
use std::path::Path;
use std::process::Output;

/// The command under test.
pub(crate) const BIN: &str = env!("CARGO_BIN_EXE_replenish-bench");

/// Runs it to its end.
pub(crate) fn run(args: &[&str]) -> Output {
    replenish_testkit::program::run(BIN, args)
}

/// Starts it beside the test.
pub(crate) fn start(args: &[&str]) -> Running {
    Running::start(BIN, args)
}

/// A JSON file of a command, held to its schema.
pub(crate) fn json(path: &Path) -> serde_json::Value {
    schema::read(path)
}

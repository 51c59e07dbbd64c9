//! C and C++ programs over an installed libreplenish: built by gcc and clang without a warning,
//! linked
//! both ways, run under sanitizers, their budgets judged.
//!
//! Trials need a compiler, and the last ones real-time priority; where it is missing they count as
//! ignored.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod build;
mod run;

fn main() {
    replenish_testkit::harness::run_in_turn([("build", build::trials()), ("run", run::trials())])
}

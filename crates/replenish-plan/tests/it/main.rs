//! Planner, deployment files and ledger, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod damaged;
mod file;
mod groups;
mod ledger;
mod ledger_attacked;
mod plan;
mod plans_random;
mod robot;
mod thousand;

//! Planner and deployment files, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod damaged;
mod file;
mod groups;
mod plan;
mod plans_random;
mod robot;
mod thousand;

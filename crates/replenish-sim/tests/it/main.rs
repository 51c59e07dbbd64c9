//! Simulation and analysis, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod common;

mod analysis;
mod analysis_terms;
mod bounds_random;
mod chains_random;
mod locks;
mod policies;
mod trace;

//! Messages and CDR, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod action;
mod bounds;
mod distances;
mod golden;
mod properties;

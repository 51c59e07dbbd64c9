//! A robot's command as a user runs it, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod boards;
mod command_line;
mod common;

mod deploy;
mod hostile;
mod laboratory;
mod live;
mod metrics;
mod openmetrics;
mod perfetto;
mod plan;
mod recorded;
mod schema;
mod schemas;
#[cfg(feature = "secure")]
mod secure;
mod suggest;
mod top;

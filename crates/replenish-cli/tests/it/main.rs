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
#[cfg(feature = "dds")]
#[allow(unreachable_pub, reason = "shared with other tests")]
#[path = "../../../replenish/tests/common/fibonacci.rs"]
mod fibonacci;

mod deploy;
mod hostile;
mod laboratory;
mod live;
mod metrics;
mod openmetrics;
mod perfetto;
mod plan;
mod recorded;
#[cfg(feature = "dds")]
mod ros2_client;
mod schema;
mod schemas;
#[cfg(feature = "secure")]
mod secure;
mod top;

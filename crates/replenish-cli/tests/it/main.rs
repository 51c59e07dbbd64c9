//! A robot's command as a user runs it, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod common;
#[cfg(feature = "dds")]
#[allow(unreachable_pub, reason = "shared with other tests")]
#[path = "../../../replenish/tests/common/fibonacci.rs"]
mod fibonacci;

mod laboratory;
mod plan;
#[cfg(feature = "dds")]
mod ros2_client;

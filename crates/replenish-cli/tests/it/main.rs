//! The command as a user runs it, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;
#[cfg(feature = "dds")]
#[allow(unreachable_pub, reason = "shared with other tests")]
#[path = "../../../replenish/tests/common/fibonacci.rs"]
mod fibonacci;

mod agent;
mod bench;
mod history;
mod parts;
mod plan;
#[cfg(feature = "dds")]
mod ros2_client;
mod suggest;

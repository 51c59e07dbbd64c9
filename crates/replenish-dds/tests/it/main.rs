//! DDS between programs of ours and of others, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

extern crate replenish_dds; // the agent's tests use the same support

mod support;

mod pairs;
mod ros2_client;

//! The laboratory, and the whole command as a user runs it, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;

#[path = "../../../replenish-agent/tests/support/cyclone.rs"]
mod cyclone;
#[path = "../../../replenish-agent/tests/support/stock_client.rs"]
mod stock_client;

mod agent;
mod attacker;
mod bench;
mod history;
mod memory;
mod nuttx;
mod nuttx_page;
mod nuttx_policy;
mod paper;
mod roles;
mod rows;
mod stream_lossy;
mod suggest;

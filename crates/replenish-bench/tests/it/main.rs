//! The laboratory, and the whole command as a user runs it, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;

mod attacker;
mod bench;
mod history;
mod memory;
mod nuttx;
mod nuttx_page;
mod nuttx_policy;
mod paper;
mod roles;
mod stream_lossy;
mod suggest;

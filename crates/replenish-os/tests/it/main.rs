//! The operating-system edge without real-time priority, in one binary.
#![cfg(not(loom))]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod clock;
mod notify;
#[cfg(not(nuttx_host))]
mod poll;
#[cfg(not(nuttx_host))]
mod tty;

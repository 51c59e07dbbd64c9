//! The interface as C sees it: its header, its symbols, its answers to wrong calls.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod abi;
mod header;
mod wrong_calls;

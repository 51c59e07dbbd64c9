//! The generated types, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../support/types.rs"]
mod types;

mod basics;
mod every_type;
mod hashes;

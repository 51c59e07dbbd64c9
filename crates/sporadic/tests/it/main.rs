//! The servers against rules, models and properties, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod common;

mod corrected_props;
mod corrected_rules;
mod defects;
mod exhaustive;
mod inherited;
mod params;
mod pending;
mod posix_props;
mod posix_rules;
mod reservation;
mod robust;
mod theorem;

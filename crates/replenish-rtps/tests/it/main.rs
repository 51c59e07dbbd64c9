//! Codec, endpoints and discovery of RTPS, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests may panic"
)]

mod addressed;
mod along;
mod best_effort;
mod discovery;
mod first_heartbeat;
mod host;
mod ipv6;
mod last_sample;
mod lossy;
mod moves;
mod shared;
mod two_readers;
mod wire_capture;
mod wire_golden;
mod wire_round_trip;

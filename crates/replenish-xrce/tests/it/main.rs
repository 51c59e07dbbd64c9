//! Codec, session and streams of DDS-XRCE, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod common;
mod fake_agent;

mod codec_capture;
mod hostile_wire;
mod round_trip;
mod session_capture;
mod session_link;
mod session_lossy;
mod session_streams;
mod stream_long;
mod stream_output;
mod stream_pace;

//! DTLS and TLS between client and agent, on loopback sockets.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

mod agent;
mod handshakes;
mod identity;
mod raw;
mod relay;
mod traffic;

//! Promises for any input, as functions of bytes. The fuzz targets (`fuzz/`) feed them with a
//! fuzzer's findings, `inputs.rs` with millions of damaged captures.
//!
//! ```text
//!   bytes ──► decoders   messages, submessages, framing: a value or an error, and back again
//!         ──► cdr        messages of ROS
//!         ──► text       XML and references
//!         ──► agent      a script: datagrams from several addresses, and time
//!         ──► bridge     the same, and samples from the other side of its bridge
//!         ──► client     a script: datagrams, time, what an application does
//! ```
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every binary uses its own part")]

pub(crate) mod agent;
pub(crate) mod bridge;
pub(crate) mod cdr;
pub(crate) mod client;
pub(crate) mod decoders;
pub(crate) mod text;

pub(crate) const MS: u64 = 1_000_000;

/// Reads a script: whatever is missing at its end is zero or empty.
pub(crate) struct Script<'a>(pub(crate) &'a [u8]);

impl<'a> Script<'a> {
    pub(crate) fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }

    /// Bytes with their number, as two bytes, before them.
    pub(crate) fn run(&mut self) -> &'a [u8] {
        let len = usize::from(u16::from_le_bytes([self.byte(), self.byte()]));
        let (run, rest) = self.0.split_at(len.min(self.0.len()));
        self.0 = rest;
        run
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// One step of a script: see [`agent::Agent::step`] and [`client::Client::step`].
pub(crate) fn datagram(op: u8, bytes: &[u8]) -> Vec<u8> {
    let len = u16::try_from(bytes.len()).unwrap_or(u16::MAX).to_le_bytes();
    [&[op], &len[..], bytes].concat()
}

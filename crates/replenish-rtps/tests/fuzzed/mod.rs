//! Promises for any input, as functions of bytes or of choices. The fuzz targets (`fuzz/`) feed
//! them with a fuzzer's findings, `inputs.rs` with millions of random choices.
//!
//! ```text
//!   bytes   ──► decoders    messages, submessages, discovery, names: a value or an error
//!   choices ──► datagrams   structured traffic of strangers, some of it damaged
//!                   └─────► node       a whole participant, beside an honest peer
//! ```
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every binary uses its own part")]

pub(crate) mod datagrams;
pub(crate) mod decoders;
pub(crate) mod node;

/// Decisions, by chance or from a script.
pub(crate) trait Choice {
    /// A number below `end`, which is at least 1.
    fn below(&mut self, end: usize) -> usize;

    fn byte(&mut self) -> u8 {
        self.below(256) as u8
    }

    fn number(&mut self, end: usize) -> i64 {
        i64::try_from(self.below(end)).unwrap_or(0)
    }

    fn one_in(&mut self, many: usize) -> bool {
        self.below(many) == 0
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}

/// xorshift64*.
pub(crate) struct Random(pub(crate) u64);

impl Choice for Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let high = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32;
        ((high * end as u64) >> 32) as usize
    }
}

/// Reads a script: its end is all zeros.
pub(crate) struct Script<'a>(pub(crate) &'a [u8]);

impl Choice for Script<'_> {
    fn below(&mut self, end: usize) -> usize {
        let bytes = if end > 256 { 2 } else { 1 };
        let mut number = 0;
        for _ in 0..bytes {
            let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
            self.0 = rest;
            number = number * 256 + usize::from(*first);
        }
        number % end
    }
}

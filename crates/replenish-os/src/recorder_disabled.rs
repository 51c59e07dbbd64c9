//! In the place of the board's recorder, without feature `recorder`, and on Linux, where the
//! executor records into a file: nothing is recorded here.
#![expect(
    clippy::missing_const_for_fn,
    reason = "the signatures of what it stands in for"
)]

use crate::{Nanos, Usage};

/// Whether anything is recorded in this build.
pub const ON: bool = false;
/// The topic on which pieces are sent.
pub const TOPIC: &str = "/replenish/recorder";
/// Bytes of the longest piece.
pub const PIECE: usize = 208;

/// The kind of an event.
#[expect(missing_docs, reason = "as in replenish-recorder")]
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    Take,
    Wake,
    Publish,
    Block,
    Miss,
    Drop,
    Skip,
    Panic,
    Mark,
    Queue,
}

/// The kind of a name.
#[expect(missing_docs, reason = "as in replenish-recorder")]
#[derive(Debug, Clone, Copy)]
pub enum NameKind {
    Handle,
    Topic,
    Mark,
}

/// No name is kept.
#[derive(Debug, Clone, Copy)]
pub struct Name(());

impl Name {
    /// No name.
    pub const NONE: Self = Self(());

    /// No name.
    #[must_use]
    pub const fn of(_: NameKind, _: &str) -> Self {
        Self::NONE
    }
}

/// A thread has no place.
#[derive(Debug, Default)]
pub struct Slot(());

/// Nothing is forgotten.
pub fn restart() {}

/// Nothing is laid out.
pub fn lay(_: &Slot, _: &str, _: bool, _: Option<(u64, u64)>) {}

/// Nothing is recorded.
pub fn install(_: &Slot, _: &str) -> u8 {
    0
}

/// Nothing is recorded.
pub fn event(_: Kind, _: Name, _: Nanos, _: [u64; 2]) {}

/// Nothing is recorded.
pub fn event_now(_: Kind, _: Name, _: [u64; 2]) {}

/// Nothing is recorded.
pub fn begin(_: Name, _: Nanos, _: Nanos) {}

/// Nothing is recorded.
pub fn end(_: Nanos) {}

/// Nothing is sent.
#[derive(Debug)]
pub struct Feed(());

impl Feed {
    /// A recorder that records nothing.
    #[must_use]
    pub const fn new(_: &str) -> Self {
        Self(())
    }

    /// Nothing was sent.
    pub fn sent(&mut self) {}

    /// There is no description.
    pub fn description(&mut self, _: impl Fn(&str) -> Usage, _: &mut [u8; PIECE]) -> usize {
        0
    }

    /// There are no events.
    pub fn events(&mut self, _: Option<i64>, _: &mut [u8; PIECE]) -> usize {
        0
    }

    /// Whether all descriptions were sent once.
    #[must_use]
    pub const fn is_described(&self) -> bool {
        true
    }
}

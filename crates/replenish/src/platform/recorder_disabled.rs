//! In the place of `std/recorder` in builds without feature `std`: nothing is recorded.
#![expect(
    clippy::unnecessary_wraps,
    clippy::missing_const_for_fn,
    reason = "the signatures of what it stands in for"
)]

use crate::Nanos;
use crate::platform::Text;
use replenish_os::{Account, Usage};

/// No name is kept.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NameId;

/// The program's own point in the recording; nothing is recorded in this build.
#[derive(Debug, Clone, Copy)]
pub struct Mark(());

impl Mark {
    /// A mark that is not recorded.
    #[must_use]
    pub const fn new(_name: &str) -> Self {
        Self(())
    }
}

/// Nothing is recorded, so nothing is dumped.
#[derive(Debug, Clone)]
pub struct Dump(());

/// How much is to be recorded.
#[derive(Debug, Clone, Default)]
pub(crate) struct Settings {
    pub(crate) bytes: usize,
    #[allow(dead_code, reason = "nobody reads it")]
    pub(crate) dump: Option<Dump>,
}

/// A thread that is to start.
#[allow(dead_code, reason = "nobody reads it")]
pub(crate) struct ThreadFacts<'a> {
    pub(crate) slot: &'a ThreadSlot,
    pub(crate) name: &'a str,
    pub(crate) dispatches: bool,
    pub(crate) cpu: Option<usize>,
    pub(crate) budget: Option<(u64, u64)>,
}

/// A thread has no places.
#[derive(Debug, Default)]
pub(crate) struct ThreadSlot(());

impl ThreadSlot {
    pub(crate) fn install(&self, _: &Account, _: &str) {}
}

/// No recording.
#[derive(Debug, Default)]
pub(crate) struct Recording {
    pub(crate) fallback: Option<Text>,
}

impl Recording {
    pub(crate) fn start<'a>(
        _: &Settings,
        _: impl Iterator<Item = ThreadFacts<'a>>,
    ) -> Result<Self, Text> {
        Ok(Self::default())
    }

    pub(crate) fn end(&mut self) {}
}

pub(crate) fn handle(_: &str) -> NameId {
    NameId
}

pub(crate) fn topic(_: &str) -> NameId {
    NameId
}

pub(crate) fn take(_: NameId, _: Nanos, _: usize) {}

pub(crate) fn dropped(_: NameId, _: Nanos, _: usize) {}

pub(crate) fn wake(_: Nanos, _: Nanos) {}

pub(crate) fn block() {}

pub(crate) fn begin(_: NameId, _: Nanos, _: Nanos) {}

pub(crate) fn end(_: Nanos) {}

pub(crate) fn spoiled() {}

pub(crate) fn panicked(_: NameId) {}

pub(crate) fn miss(_: NameId, _: Nanos, _: Nanos, _: Nanos) {}

pub(crate) fn skip(_: NameId, _: u64) {}

pub(crate) fn publish(_: NameId, _: usize, _: bool) {}

pub(crate) fn mark(_: Mark, _: u64) {}

pub(crate) fn used(_: &Usage) {}

pub(crate) fn queue(_: NameId, _: Nanos, _: Option<NameId>) {}

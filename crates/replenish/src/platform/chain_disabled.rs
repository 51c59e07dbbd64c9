//! In the place of `std/chain` in builds without feature `std`: no chain is measured.
#![expect(
    clippy::missing_const_for_fn,
    clippy::unused_self,
    reason = "the signatures of what it stands in for"
)]

use crate::Nanos;
use crate::event::Events;
use crate::handoff::{Origins, SampleInfo};

/// Chains are not measured in this build.
#[derive(Debug, Default)]
pub(crate) struct Requested(());

/// A handle that is no stage of a chain.
#[derive(Default)]
pub(crate) struct Links(());

impl Links {
    pub(crate) fn begin(&mut self, _: Nanos, _: Nanos, _: &Provenance) {}

    pub(crate) fn end(&mut self, _: Option<Nanos>, _: &Events) {}
}

/// Nothing.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Provenance(());

impl Provenance {
    pub(crate) fn of(_: &SampleInfo) -> Self {
        Self(())
    }
}

pub(crate) fn current() -> Origins {
    Origins::NONE
}

pub(crate) fn resume(_: Origins) {}

#[allow(dead_code, reason = "named by middlewares that need feature `std`")]
pub(crate) const fn sent<const N: usize>() -> [(u64, Nanos); N] {
    [(0, 0); N]
}

#[allow(dead_code, reason = "named by middlewares that need feature `std`")]
pub(crate) fn came(_: &[(u64, Nanos)], _: Nanos) -> Origins {
    Origins::NONE
}

//! In the place of `note` without feature `full`: there are no services and no stamps.

use crate::Nanos;
use crate::middleware::SampleInfo;

/// The arrival alone.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Note(Nanos);

impl Note {
    pub(super) const fn of(info: &SampleInfo) -> Self {
        Self(info.arrival)
    }

    pub(super) const fn info(&self) -> SampleInfo {
        SampleInfo::at(self.0)
    }
}

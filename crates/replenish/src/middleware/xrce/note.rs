//! The part of a sample's information that is kept while the sample waits.

use crate::middleware::SampleInfo;

/// All of it. `note_disabled.rs` takes this file's place without feature `full`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Note(SampleInfo);

impl Note {
    pub(super) const fn of(info: &SampleInfo) -> Self {
        Self(*info)
    }

    pub(super) const fn info(&self) -> SampleInfo {
        self.0
    }
}

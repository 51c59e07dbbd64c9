//! Handles that are added to a running worker together: all of them, or none.

use super::live::{LiveWorker, Removal};
use crate::error::Error;
use alloc::string::String;
use alloc::vec::Vec;

/// Handles that belong together; those that are there are removed if one cannot be added.
pub(crate) struct Added<'e> {
    worker: LiveWorker<'e>,
    ids: Vec<String>,
}

impl<'e> Added<'e> {
    pub(crate) fn to(worker: &LiveWorker<'e>) -> Self {
        Self {
            worker: worker.again(),
            ids: Vec::new(),
        }
    }

    /// The worker, for the next of them.
    pub(crate) fn worker(&self) -> LiveWorker<'e> {
        self.worker.again()
    }

    pub(crate) fn keep(&mut self, id: Result<String, Error>) -> Result<(), Error> {
        self.ids.push(id?);
        Ok(())
    }

    pub(crate) fn done(mut self) -> Vec<String> {
        core::mem::take(&mut self.ids)
    }
}

impl Drop for Added<'_> {
    fn drop(&mut self) {
        for id in &self.ids {
            // One that somebody else has removed meanwhile is gone as well.
            self.worker.executor().remove(id, Removal::Detach).ok();
        }
    }
}

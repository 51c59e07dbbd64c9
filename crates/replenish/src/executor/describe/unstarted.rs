//! [`Unstarted`]: the workers of an executor that has not started.

use crate::executor::run::state::WorkerSpec;
use crate::middleware::Middleware;
use crate::platform::{FULL, Static};
use crate::sync::Arc;
use alloc::vec::Vec;
use core::ops::{Deref, DerefMut};

/// The workers as they are described. Dropped, they have not started, and their readers go with
/// them: nobody would take the samples of a subscription that is left.
pub(crate) struct Unstarted {
    middleware: Arc<dyn Middleware>,
    workers: Vec<Static<WorkerSpec>>,
}

impl Unstarted {
    pub(crate) const fn new(middleware: Arc<dyn Middleware>) -> Self {
        Self {
            middleware,
            workers: Vec::new(),
        }
    }

    /// The workers, whose readers are somebody else's to delete from now on.
    pub(crate) fn begin(mut self) -> Vec<Static<WorkerSpec>> {
        core::mem::take(&mut self.workers)
    }
}

impl Deref for Unstarted {
    type Target = Vec<Static<WorkerSpec>>;

    fn deref(&self) -> &Self::Target {
        &self.workers
    }
}

impl DerefMut for Unstarted {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.workers
    }
}

impl Drop for Unstarted {
    fn drop(&mut self) {
        if !FULL {
            return; // a board has one executor, and it starts
        }
        let entries = self.workers.iter().flat_map(|worker| &worker.entries);
        for (reader, _) in entries.filter_map(|entry| entry.shared.input.as_ref()) {
            // A middleware that cannot do it keeps the reader.
            self.middleware.delete_reader(*reader).ok();
        }
    }
}

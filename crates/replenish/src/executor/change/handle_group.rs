//! Handles that are added to a running worker together: all of them, or none.

use super::live::{Removal, WorkerHandle};
use crate::error::Error;
use crate::executor::handles::client::Client;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_msg::Service;

/// Handles that belong together; those that are there are removed if one cannot be added.
pub(crate) struct HandleGroup<'e> {
    worker: WorkerHandle<'e>,
    ids: Vec<String>,
}

impl<'e> HandleGroup<'e> {
    pub(crate) fn to(worker: &WorkerHandle<'e>) -> Self {
        Self {
            worker: worker.again(),
            ids: Vec::new(),
        }
    }

    /// The worker, for the next of them.
    pub(crate) fn worker(&self) -> WorkerHandle<'e> {
        self.worker.again()
    }

    pub(crate) fn keep(&mut self, id: Result<String, Error>) -> Result<(), Error> {
        self.ids.push(id?);
        Ok(())
    }

    /// Samples of the handle that was kept last come before replies of `client` that arrive later.
    pub(crate) fn put_ahead_of<S: Service>(&self, client: &Client<S>) {
        if let Some(handle) = self.ids.last().and_then(|id| self.worker.handle(id)) {
            client.lets_ahead(&handle);
        }
    }

    pub(crate) fn done(mut self) -> Vec<String> {
        core::mem::take(&mut self.ids)
    }
}

impl Drop for HandleGroup<'_> {
    fn drop(&mut self) {
        for id in &self.ids {
            // One that somebody else has removed meanwhile is gone as well.
            self.worker
                .executor_handle()
                .remove(id, Removal::Detach)
                .ok();
        }
    }
}

//! Executors that run hand out the handle that changes them.

use super::local::LocalExecutor;
use super::running::RunningExecutor;
use crate::executor::change::ExecutorHandle;
use crate::sync::Arc;

impl RunningExecutor {
    /// Adds and removes handles while it runs.
    #[must_use]
    pub fn handle(&self) -> ExecutorHandle {
        let live = Arc::clone(&self.live);
        ExecutorHandle { live }
    }
}

impl LocalExecutor {
    /// Adds and removes handles, from any thread. A change between two spins happens at the next.
    #[must_use]
    pub fn handle(&self) -> ExecutorHandle {
        let live = Arc::clone(&self.live);
        ExecutorHandle { live }
    }
}

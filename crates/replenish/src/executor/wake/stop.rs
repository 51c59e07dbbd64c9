//! Stopping an executor from anywhere.

use crate::handoff::Stop;
use crate::middleware::Middleware;
use crate::sync::Arc;
use core::fmt;

/// Stops an executor: from a callback, another thread, before it started or after it ended. Clones
/// stop the same executor.
///
/// A stop lasts, and none is lost: one that comes before the executor starts ends it at once. With
/// threads the executor is then at its end; of one without,
/// [`LocalExecutor::restart`](crate::LocalExecutor::restart) takes the stop back. (In rclcpp
/// `cancel` ends the spin that runs, is lost if none does, and the next one runs again; rclc has no
/// stop.)
#[derive(Clone)]
pub struct StopHandle {
    pub(crate) stop: Arc<Stop>,
    /// The dispatcher waits here.
    waker: Arc<dyn Middleware>,
}

impl StopHandle {
    /// Stops an executor whose dispatcher waits on `waker`.
    pub(crate) fn new(waker: Arc<dyn Middleware>) -> Self {
        Self {
            stop: Arc::new(Stop::new()),
            waker,
        }
    }
}

impl StopHandle {
    /// Asks for the end and returns at once. No callback starts any more; those that run are left
    /// to finish (see [`Executor::stop_grace`](crate::Executor::stop_grace)).
    pub fn stop(&self) {
        self.stop.request();
        self.waker.wake();
    }

    /// Whether the end was asked for.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.stop.is_requested()
    }
}

impl fmt::Debug for StopHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StopHandle")
            .field("stopping", &self.is_stopping())
            .finish_non_exhaustive()
    }
}

//! Ends a running agent from another thread: a flag, and the wake-up of its wait.

use replenish_os::WakeFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Stops agents that run with it, from any thread and any number of times. Clones are the same
/// handle.
#[derive(Clone, Debug, Default)]
pub struct StopHandle {
    state: Arc<StopState>,
}

#[derive(Debug, Default)]
struct StopState {
    stopped: AtomicBool,
    /// The agents that run with this handle.
    running: Mutex<Vec<Arc<WakeFd>>>,
}

impl StopHandle {
    /// A handle that has not stopped anything.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Stops the agents that run with this handle, now and later, for good. Does not
    /// wait for them.
    pub fn stop(&self) {
        self.state.stopped.store(true, Ordering::SeqCst);
        for agent in self.running().iter() {
            agent.wake();
        }
    }

    /// Whether [`stop`](Self::stop) was called.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.state.stopped.load(Ordering::SeqCst)
    }

    /// Registers a running agent and its `wake` until the result is dropped. The agent
    /// must look at [`is_stopped`](Self::is_stopped) after this and before it waits.
    pub(super) fn runs(&self, wake: &Arc<WakeFd>) -> Running<'_> {
        self.running().push(Arc::clone(wake));
        Running {
            stop: self,
            wake: Arc::clone(wake),
        }
    }

    fn running(&self) -> MutexGuard<'_, Vec<Arc<WakeFd>>> {
        let running = self.state.running.lock();
        running.unwrap_or_else(PoisonError::into_inner)
    }
}

/// An agent that runs; see [`StopHandle::runs`].
pub(super) struct Running<'a> {
    stop: &'a StopHandle,
    wake: Arc<WakeFd>,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.stop
            .running()
            .retain(|wake| !Arc::ptr_eq(wake, &self.wake));
    }
}

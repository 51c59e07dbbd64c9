//! An agent in a thread of its own.

use super::access::AccessControl;
use super::inspector::Inspector;
use super::stop::StopHandle;
use crate::error::AgentError;
use crate::report::{Counters, Stats};
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;

/// An agent that runs in a thread of its own. Dropping it stops it.
#[derive(Debug)]
pub struct RunningAgent {
    pub(super) addr: SocketAddr,
    pub(super) tcp: Option<SocketAddr>,
    pub(super) inspector: Inspector,
    pub(super) access: AccessControl,
    pub(super) stop: StopHandle,
    pub(super) counters: Arc<Counters>,
    pub(super) thread: Option<JoinHandle<Result<(), AgentError>>>,
}

impl RunningAgent {
    /// The first UDP address that it listens at.
    #[must_use]
    pub fn local_addr(&self) -> SocketAddr {
        self.addr
    }

    /// The TCP address that it listens at, if any.
    #[must_use]
    pub fn tcp_addr(&self) -> Option<SocketAddr> {
        self.tcp
    }

    /// Takes snapshots of the agent.
    #[must_use]
    pub fn inspector(&self) -> &Inspector {
        &self.inspector
    }

    /// Replaces its access list.
    #[must_use]
    pub fn access_control(&self) -> &AccessControl {
        &self.access
    }

    /// The counters so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.counters.snapshot()
    }

    /// Whether it still runs. It ends by itself only when its socket fails; [`stop`](Self::stop)
    /// then returns the reason.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.thread
            .as_ref()
            .is_some_and(|thread| !thread.is_finished())
    }

    /// Stops it and waits until its thread has ended and its address is free.
    ///
    /// # Errors
    /// The error that ended the agent.
    pub fn stop(mut self) -> Result<Stats, AgentError> {
        self.join()?;
        Ok(self.stats())
    }

    fn join(&mut self) -> Result<(), AgentError> {
        self.stop.stop();
        match self.thread.take().map(JoinHandle::join) {
            None => Ok(()),
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }
}

impl Drop for RunningAgent {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            // The error that ended the agent is lost here; `stop` returns it.
            drop(self.join());
        }
    }
}

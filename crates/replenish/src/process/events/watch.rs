//! [`EventWatch`]: the latest status of an endpoint, between the middleware and a callback.

use crate::executor::GuardCondition;
use crate::middleware::{EndStatus, Watch};
use crate::sync::{Arc, AtomicBool, Mutex, Ordering};

pub(super) struct EventWatch {
    latest: Mutex<Latest>,
    guard: GuardCondition,
    closed: AtomicBool,
}

#[derive(Default)]
struct Latest {
    status: EndStatus,
    /// The callback has been rung for and has not looked yet.
    rung: bool,
}

impl EventWatch {
    /// A watch that wakes the worker of `guard`.
    pub(super) fn new(guard: GuardCondition) -> Self {
        Self {
            latest: Mutex::new(Latest::default()),
            guard,
            closed: AtomicBool::new(false),
        }
    }
}

impl Watch for EventWatch {
    fn update(&self, status: &EndStatus) -> bool {
        let mut latest = self.latest.lock();
        if latest.status == *status {
            return false;
        }
        latest.status = *status;
        !core::mem::replace(&mut latest.rung, true)
    }

    fn ring(&self) {
        self.guard.trigger();
    }

    fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }
}

/// The callback's side. Dropping it ends the watch.
pub(super) struct Look(pub(super) Arc<EventWatch>);

impl Look {
    /// The latest status.
    pub(super) fn take(&self) -> EndStatus {
        let mut latest = self.0.latest.lock();
        latest.rung = false;
        latest.status
    }
}

impl Drop for Look {
    fn drop(&mut self) {
        self.0.closed.store(true, Ordering::Release);
    }
}

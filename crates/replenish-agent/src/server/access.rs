//! A new access list for a running agent, from another thread.

use crate::config::AccessList;
use replenish_os::WakeFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Gives a running agent a new access list.
#[derive(Clone, Debug)]
pub struct AccessControl {
    wake: Arc<WakeFd>,
    update: Arc<AccessUpdate>,
}

/// The list that the agent has not taken yet.
#[derive(Debug, Default)]
pub(super) struct AccessUpdate {
    pending: AtomicBool,
    list: Mutex<Option<AccessList>>,
}

impl AccessControl {
    pub(super) fn new(wake: Arc<WakeFd>, update: Arc<AccessUpdate>) -> Self {
        Self { wake, update }
    }

    /// Goes by `list` from the next datagram on. Sessions that it does not allow end.
    pub fn replace(&self, list: AccessList) {
        let slot = self.update.list.lock();
        *slot.unwrap_or_else(PoisonError::into_inner) = Some(list);
        self.update.pending.store(true, Ordering::Release);
        self.wake.wake();
    }
}

impl AccessUpdate {
    /// The new list, if there is one. Never waits.
    pub(super) fn take(&self) -> Option<AccessList> {
        if !self.pending.load(Ordering::Acquire) {
            return None;
        }
        // The thread that is just giving one sets the flag and wakes the agent after that.
        let mut slot = self.list.try_lock().ok()?;
        self.pending.store(false, Ordering::Relaxed);
        slot.take()
    }
}

//! Asking a running agent what it is doing.

use super::peer::Peer;
use crate::report::{RejectionLog, Rejections, Snapshot};
use replenish_os::WakeFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Takes snapshots of an agent from other threads. The agent never waits for them.
#[derive(Clone, Debug)]
pub struct Inspector {
    wake: Arc<WakeFd>,
    requests: Arc<SnapshotRequests>,
    log: Arc<RejectionLog<Peer>>,
}

/// Who wants a snapshot.
#[derive(Debug, Default)]
pub(super) struct SnapshotRequests {
    pending: AtomicBool,
    senders: Mutex<Vec<SyncSender<Snapshot>>>,
}

impl Inspector {
    pub(super) fn new(
        wake: Arc<WakeFd>,
        requests: Arc<SnapshotRequests>,
        log: Arc<RejectionLog<Peer>>,
    ) -> Self {
        Self {
            wake,
            requests,
            log,
        }
    }

    /// What was refused since the last look, by whichever of the clones. The last 32 rejections of
    /// each kind are kept; what there was besides is counted.
    #[must_use]
    pub fn rejections(&self) -> Rejections {
        self.log.drain()
    }

    /// What the agent is doing, or `None` if it does not say within `timeout`, because it does not
    /// run.
    #[must_use]
    pub fn snapshot(&self, timeout: Duration) -> Option<Snapshot> {
        let (sender, receiver) = sync_channel(1);
        let senders = self.requests.senders.lock();
        senders.unwrap_or_else(PoisonError::into_inner).push(sender);
        self.requests.pending.store(true, Ordering::Release);
        self.wake.wake();
        receiver.recv_timeout(timeout).ok()
    }
}

impl SnapshotRequests {
    /// Gives everyone who has requests what `take` gives. If somebody is just asking, the next time.
    pub(super) fn answer(&self, take: impl FnOnce() -> Snapshot) {
        if !self.pending.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut senders) = self.senders.try_lock() else {
            return; // who holds it sets the flag and wakes us after that
        };
        self.pending.store(false, Ordering::Relaxed);
        if senders.is_empty() {
            return;
        }
        let snapshot = take();
        for sender in senders.drain(..) {
            // Whoever has lost timeout does not listen any more.
            drop(sender.try_send(snapshot.clone()));
        }
    }
}

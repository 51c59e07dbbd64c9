//! Snapshots of a running agent, taken from other threads.

use super::peer::Peer;
use crate::report::{RecordedSample, Recordings, RejectionLog, Rejections, Snapshot};
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
    recordings: Arc<Recordings>,
}

/// The threads that wait for a snapshot.
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
        recordings: Arc<Recordings>,
    ) -> Self {
        Self {
            wake,
            requests,
            log,
            recordings,
        }
    }

    /// The rejections since the last call on any clone. The last 32 of
    /// each kind are kept; the others are counted.
    #[must_use]
    pub fn rejections(&self) -> Rejections {
        self.log.drain()
    }

    /// Takes the samples out that boards have sent of their recordings since the last call on any
    /// clone, into `into`; how many were dropped. From the first call on up to 512 are
    /// kept.
    pub fn recordings(&self, into: &mut Vec<RecordedSample>) -> u64 {
        self.recordings.drain(into)
    }

    /// A snapshot, or `None` if the agent gives none within `timeout`, because it does not
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
    /// Sends a snapshot to every waiting thread; next time if a thread is just asking.
    pub(super) fn answer(&self, take: impl FnOnce() -> Snapshot) {
        if !self.pending.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut senders) = self.senders.try_lock() else {
            return; // the asking thread sets the flag and wakes the agent after that
        };
        self.pending.store(false, Ordering::Relaxed);
        if senders.is_empty() {
            return;
        }
        let snapshot = take();
        for sender in senders.drain(..) {
            // A thread whose timeout is over does not listen any more.
            drop(sender.try_send(snapshot.clone()));
        }
    }
}

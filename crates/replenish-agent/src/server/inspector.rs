//! Asking a running agent what it is doing.

use super::peer::Peer;
use crate::report::{Incidents, Log, Snapshot};
use replenish_os::WakeFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Takes snapshots of an agent from other threads. The agent never waits for them.
#[derive(Clone, Debug)]
pub struct Inspector {
    wake: Arc<WakeFd>,
    asked: Arc<Asked>,
    log: Arc<Log<Peer>>,
}

/// Who wants a snapshot.
#[derive(Debug, Default)]
pub(super) struct Asked {
    any: AtomicBool,
    who: Mutex<Vec<SyncSender<Snapshot>>>,
}

impl Inspector {
    pub(super) fn new(wake: Arc<WakeFd>, asked: Arc<Asked>, log: Arc<Log<Peer>>) -> Self {
        Self { wake, asked, log }
    }

    /// What was refused since the last look, by whichever of the clones. The last 32 incidents of
    /// each kind are kept; what there was besides is counted.
    #[must_use]
    pub fn incidents(&self) -> Incidents {
        self.log.drain()
    }

    /// What the agent is doing, or `None` if it does not say within `patience`, because it does not
    /// run.
    #[must_use]
    pub fn snapshot(&self, patience: Duration) -> Option<Snapshot> {
        let (sender, receiver) = sync_channel(1);
        let who = self.asked.who.lock();
        who.unwrap_or_else(PoisonError::into_inner).push(sender);
        self.asked.any.store(true, Ordering::Release);
        self.wake.wake();
        receiver.recv_timeout(patience).ok()
    }
}

impl Asked {
    /// Gives everyone who has asked what `take` gives. If somebody is just asking, the next time.
    pub(super) fn answer(&self, take: impl FnOnce() -> Snapshot) {
        if !self.any.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut who) = self.who.try_lock() else {
            return; // who holds it sets the flag and wakes us after that
        };
        self.any.store(false, Ordering::Relaxed);
        if who.is_empty() {
            return;
        }
        let snapshot = take();
        for sender in who.drain(..) {
            // Whoever has lost patience does not listen any more.
            drop(sender.try_send(snapshot.clone()));
        }
    }
}

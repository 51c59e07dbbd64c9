//! [`Views`]: the facts that the watchdog reads without the enforcer's lock.
//!
//! The watchdog looks up to a hundred times a second, from whichever CPU. If it took the enforcer's
//! lock for that, the enforcer would wait now and then for a thread of another CPU, which
//! interrupts or a hypervisor may hold up. So whoever holds the lock keeps these up to date,
//! and the watchdog reads them without it. They may change while it reads: what seems wrong is
//! looked at again under the lock.

use super::config::NEVER;
use crate::backend::{sched, watchdog};
use crate::{Arc, Nanos, Tid};
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use sporadic::{Low, Params};
use std::sync::OnceLock;

/// In the place of a priority: it is unknown.
const UNKNOWN: u8 = u8::MAX;

/// The facts of one enforcer that the watchdog reads without its lock.
#[derive(Debug)]
pub(super) struct Views {
    due: AtomicU64,
    workers: Box<[OnceLock<Arc<View>>]>,
}

impl Views {
    pub(super) fn new(most: usize) -> Self {
        Self {
            due: AtomicU64::new(NEVER),
            workers: (0..most).map(|_| OnceLock::new()).collect(),
        }
    }

    /// Adds an enrolled thread. Set-up only.
    pub(super) fn add(&self, index: usize, view: &Arc<View>) {
        if let Some(place) = self.workers.get(index) {
            place.set(Arc::clone(view)).ok(); // a place is used once
        }
        watchdog::look_soon(); // its period may be shorter than the pause
    }

    /// The timer fires at this time, or was to do so.
    pub(super) fn set_due(&self, at: Nanos) {
        self.due.store(at, Ordering::Relaxed);
    }

    /// When the enforcer has to look next, at the latest; in the past while it does not.
    pub(super) fn due(&self) -> Nanos {
        self.due.load(Ordering::Relaxed)
    }

    /// A thread at this place, if it has not ended.
    pub(super) fn worker(&self, index: usize) -> Option<&View> {
        let view = self.workers.get(index)?.get()?;
        (!view.ended.load(Ordering::Relaxed)).then_some(&**view)
    }

    /// The threads that have not ended, by their place among the enrolled ones.
    pub(super) fn workers(&self) -> impl Iterator<Item = (usize, &View)> {
        let all = self.workers.iter().map_while(OnceLock::get).enumerate();
        let live = all.filter(|(_, view)| !view.ended.load(Ordering::Relaxed));
        live.map(|(index, view)| (index, &**view))
    }
}

/// The facts of one worker.
#[derive(Debug)]
pub(super) struct View {
    pub(super) tid: Tid,
    /// Its low priority, 0 for the time-sharing class.
    pub(super) low: u8,
    pub(super) period: Nanos,
    /// Its threads and processes begin in the time-sharing class (reset-on-fork).
    pub(super) resets: bool,
    given: AtomicU8,
    refused: AtomicBool,
    reported: AtomicBool,
    ended: AtomicBool,
}

impl View {
    /// A thread that has its high priority.
    pub(super) fn of(tid: Tid, params: &Params) -> Self {
        let low = match params.low() {
            Low::Background(low) => low,
            Low::Suspend => 0,
        };
        Self {
            tid,
            low,
            period: params.period(),
            resets: sched::base_policy(tid).is_ok_and(|(_, resets)| resets),
            given: AtomicU8::new(params.priority()),
            refused: AtomicBool::new(false),
            reported: AtomicBool::new(false),
            ended: AtomicBool::new(false),
        }
    }

    /// The priority that the worker was given last, 0 in the time-sharing class; unknown after a
    /// refusal.
    pub(super) fn given(&self) -> Option<u8> {
        let given = self.given.load(Ordering::Relaxed);
        (given != UNKNOWN).then_some(given)
    }

    /// The thread has this priority from now on, or an unknown one.
    pub(super) fn give(&self, given: Option<u8>) {
        self.given
            .store(given.unwrap_or(UNKNOWN), Ordering::Relaxed);
    }

    /// Whether the kernel refuses the change that is due.
    pub(super) fn is_refused(&self) -> bool {
        self.refused.load(Ordering::Relaxed)
    }

    /// The kernel refuses it, or does so no longer.
    pub(super) fn set_refused(&self, refused: bool) {
        self.refused.store(refused, Ordering::Relaxed);
        if !refused {
            self.reported.store(false, Ordering::Relaxed);
        }
    }

    /// The thread has ended, or is enforced no longer.
    pub(super) fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
    }

    /// Whether the kernel refuses the change that is due, and nobody was told yet.
    pub(super) fn is_news(&self) -> bool {
        self.is_refused() && !self.reported.swap(true, Ordering::Relaxed)
    }

    #[cfg(test)]
    pub(super) fn is_reported(&self) -> bool {
        self.reported.load(Ordering::Relaxed)
    }
}

//! The watchdog's view of a worker, and the recorder's.
//!
//! The watchdog looks up to a hundred times a second, from whichever CPU. If it took the enforcer's
//! lock for that, the enforcer would wait now and then for a thread of another CPU, which
//! interrupts or a hypervisor may hold up. So whoever holds the lock keeps [`Views`] up to date,
//! and the watchdog reads them without it. They may change while it reads: what seems wrong is
//! looked at again under the lock.

use super::budget_record::BudgetRecord;
use super::config::{AnyServer, NEVER};
use crate::backend::blocking_detector::Switch;
use crate::backend::watchdog;
use crate::{Arc, Level, Nanos, Tid};
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use replenish_recorder::Kind;
use sporadic::{Low, Params, Reservation};
use std::sync::OnceLock;

/// In the place of a priority: it is unknown.
const UNKNOWN: u8 = u8::MAX;

/// What the watchdog looks at without the enforcer's lock.
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
    pub(super) fn add(&self, index: usize, thread: &Supervised) {
        if let Some(place) = self.workers.get(index) {
            place.set(Arc::clone(&thread.view)).ok(); // a place is used once
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

    /// The threads that have not ended, by their place among the enrolled ones.
    pub(super) fn workers(&self) -> impl Iterator<Item = (usize, &View)> {
        let all = self.workers.iter().map_while(OnceLock::get).enumerate();
        let live = all.filter(|(_, view)| !view.ended.load(Ordering::Relaxed));
        live.map(|(index, view)| (index, &**view))
    }
}

/// The same of one worker.
#[derive(Debug)]
pub(super) struct View {
    pub(super) tid: Tid,
    /// Its low priority, 0 for the time-sharing class.
    pub(super) low: u8,
    pub(super) period: Nanos,
    given: AtomicU8,
    refused: AtomicBool,
    reported: AtomicBool,
    ended: AtomicBool,
}

impl View {
    /// The priority that the worker was given last, 0 in the time-sharing class; unknown after a
    /// refusal.
    pub(super) fn given(&self) -> Option<u8> {
        let given = self.given.load(Ordering::Relaxed);
        (given != UNKNOWN).then_some(given)
    }

    /// Whether the kernel refuses the change that is due, and nobody was told yet.
    pub(super) fn is_news(&self) -> bool {
        self.refused.load(Ordering::Relaxed) && !self.reported.swap(true, Ordering::Relaxed)
    }

    #[cfg(test)]
    pub(super) fn is_reported(&self) -> bool {
        self.reported.load(Ordering::Relaxed)
    }
}

/// State that each change of the worker's priority keeps up to date.
#[derive(Debug)]
pub(super) struct Supervised {
    pub(super) view: Arc<View>,
    /// Number of times that the thread was found with another priority.
    pub(super) foreign: u64,
    /// The recorder's place for its budget.
    record: Option<BudgetRecord>,
}

impl Supervised {
    /// A thread that has its high priority.
    pub(super) fn of(tid: Tid, params: &Params) -> Self {
        let low = match params.low() {
            Low::Background(low) => low,
            Low::Suspend => 0,
        };
        let view = View {
            tid,
            low,
            period: params.period(),
            given: AtomicU8::new(params.priority()),
            refused: AtomicBool::new(false),
            reported: AtomicBool::new(false),
            ended: AtomicBool::new(false),
        };
        Self {
            view: Arc::new(view),
            foreign: 0,
            record: None,
        }
    }

    /// The thread has this priority from now on, or an unknown one.
    pub(super) fn give(&self, given: Option<u8>) {
        let given = given.unwrap_or(UNKNOWN);
        self.view.given.store(given, Ordering::Relaxed);
    }

    /// The watchdog need not look at the thread any more.
    pub(super) fn end(&self) {
        self.view.ended.store(true, Ordering::Relaxed);
    }

    /// Records the thread's budget here from now on.
    pub(super) fn record_to(&mut self, record: BudgetRecord) {
        self.record = Some(record);
    }

    /// Takes its switches as they are read: when it left the CPU, or got it.
    pub(super) fn switches(&mut self) -> impl FnMut(Nanos, Switch) {
        |time, switch| {
            if let Some(record) = &mut self.record {
                match switch {
                    Switch::In => record.write(Kind::On, time, 0, 0),
                    Switch::Preempted => record.write(Kind::Off, time, 0, 0),
                    Switch::Blocked => record.write(Kind::Off, time, 1, 0),
                }
            }
        }
    }

    /// Notes that the thread left its wait, or is about to wait.
    pub(super) fn turned(&mut self, of: &Reservation<AnyServer>, now: Nanos, active: bool) {
        if let Some(record) = &mut self.record {
            let (left, cpu) = record.totals(of, now);
            let kind = if active { Kind::Activate } else { Kind::Block };
            record.write(kind, now, left, cpu);
        }
    }

    /// Notes that the account was brought up to date, and whether it showed that the thread
    /// blocked.
    pub(super) fn observed(&mut self, of: &Reservation<AnyServer>, now: Nanos, blocked: bool) {
        if let Some(record) = &mut self.record {
            let (left, cpu) = record.totals(of, now);
            let kind = if blocked { Kind::Unblock } else { Kind::Used };
            record.write(kind, now, left, cpu);
        }
    }

    /// Notes that the thread has this level since `now`; the judgement was `late` ns late.
    pub(super) fn applied(
        &mut self,
        of: &Reservation<AnyServer>,
        now: Nanos,
        level: Level,
        late: Nanos,
    ) {
        if let Some(record) = &mut self.record {
            let (left, _) = record.totals(of, now);
            match level {
                Level::Low => record.write(Kind::Exhausted, now, late, 0),
                Level::High => record.write(Kind::Replenished, now, left, 0),
            }
            let low = u64::from(level == Level::Low);
            record.write(Kind::Level, now, low, left);
        }
    }

    /// Whether the last change was refused.
    pub(super) fn is_refused(&self) -> bool {
        self.view.refused.load(Ordering::Relaxed)
    }

    /// A change of priority was carried out as far as it is `given`. Its level is in force if it
    /// was `obeyed`.
    pub(super) fn note(&self, given: Option<u8>, obeyed: bool) {
        self.give(given);
        self.view.refused.store(!obeyed, Ordering::Relaxed);
        if obeyed {
            self.view.reported.store(false, Ordering::Relaxed);
        }
    }
}

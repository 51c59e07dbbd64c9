//! The watchdog's view of a worker, and the recorder's.

use super::budget_record::BudgetRecord;
use super::config::AnyServer;
use super::views::{View, Views};
use crate::backend::blocking_detector::Switch;
use crate::backend::sched;
use crate::{Arc, Level, Nanos, Tid};
use replenish_recorder::Kind;
use sporadic::{Params, Reservation};

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
        Self {
            view: Arc::new(View::of(tid, params)),
            foreign: 0,
            record: None,
        }
    }

    /// Shows the thread to the watchdog, at its place among the enrolled ones. Set-up only.
    pub(super) fn show(&self, views: &Views, index: usize) {
        views.add(index, &self.view);
    }

    /// The thread has this priority from now on, or an unknown one.
    pub(super) fn give(&self, given: Option<u8>) {
        self.view.give(given);
    }

    /// The watchdog need not look at the thread any more.
    pub(super) fn end(&self) {
        self.view.end();
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

    /// Whether the thread has a priority above the one that it was given.
    pub(super) fn is_above_its_own(&self) -> bool {
        let has = || sched::real_time_priority(self.view.tid);
        let is_above = |given: u8| has().is_ok_and(|has| has > given.into());
        self.view.given().is_some_and(is_above)
    }

    /// Whether the last change was refused.
    pub(super) fn is_refused(&self) -> bool {
        self.view.is_refused()
    }

    /// A change of priority was carried out as far as it is `given`. Its level is in force if it
    /// was `obeyed`.
    pub(super) fn note(&self, given: Option<u8>, obeyed: bool) {
        self.view.give(given);
        self.view.set_refused(!obeyed);
    }
}

//! The watchdog's view of a worker, and the recorder's.

use super::budget_record::BudgetRecord;
use super::config::AnyServer;
use crate::backend::blocking_detector::Switch;
use crate::{Level, Nanos};
use replenish_recorder::Kind;
use sporadic::Reservation;

/// State that each change of the worker's priority keeps up to date.
#[derive(Debug)]
pub(super) struct Supervised {
    /// The priority that the worker was given last, 0 in the time-sharing class; unknown after a
    /// refusal.
    pub(super) given: Option<u8>,
    /// Number of times that the thread was found with another priority.
    pub(super) foreign: u64,
    /// The kernel refuses the change that is due.
    pub(super) refused: bool,
    /// The refusal was reported.
    pub(super) reported: bool,
    /// The recorder's place for its budget.
    record: Option<BudgetRecord>,
}

impl Supervised {
    pub(super) const fn given(priority: u8) -> Self {
        Self {
            given: Some(priority),
            foreign: 0,
            refused: false,
            reported: false,
            record: None,
        }
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
    pub(super) const fn is_refused(&self) -> bool {
        self.refused
    }

    /// A change of priority was carried out as far as it is `given`. Its level is in force if it
    /// was `obeyed`.
    pub(super) const fn note(&mut self, given: Option<u8>, obeyed: bool) {
        self.given = given;
        self.refused = !obeyed;
        self.reported &= self.refused;
    }
}

//! In the place of `supervised.rs` on a board that records: no watchdog, and the events of a budget
//! go into the board's ring.

use super::config::AnyServer;
use super::views::Views;
use crate::backend::blocking_detector::Switch;
use crate::recorder::{Kind, budget_event};
use crate::{Level, Nanos, Tid};
use sporadic::{BudgetServer, Params, Reservation};

#[derive(Debug)]
pub(super) struct Supervised {
    /// The number of its task; 0: it is not recorded.
    task: u8,
}

impl Supervised {
    pub(super) const fn of(_: Tid, _: &Params) -> Self {
        Self { task: 0 }
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn end(&self) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn show(&self, _: &Views, _: usize) {}

    /// The events of the budget are those of this task from now on.
    pub(super) const fn record_as(&mut self, task: u8) {
        self.task = task;
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_above_its_own(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_refused(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn note(&self, _: Option<u8>, _: bool) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) fn switches(&mut self) -> impl FnMut(Nanos, Switch) + use<> {
        |_, _| ()
    }

    fn write(&self, kind: Kind, now: Nanos, values: [u64; 2]) {
        if self.task > 0 {
            budget_event(self.task, kind, now, values);
        }
    }

    /// Notes that the thread left its wait, or is about to wait.
    pub(super) fn turned(&mut self, of: &Reservation<AnyServer>, now: Nanos, active: bool) {
        let kind = if active { Kind::Activate } else { Kind::Block };
        self.write(kind, now, [of.server().available(now), 0]);
    }

    /// Notes that the account was brought up to date, and whether it showed that the thread
    /// blocked.
    pub(super) fn observed(&mut self, of: &Reservation<AnyServer>, now: Nanos, blocked: bool) {
        if blocked {
            self.write(Kind::Unblock, now, [of.server().available(now), 0]);
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
        let left = of.server().available(now);
        match level {
            Level::Low => self.write(Kind::Exhausted, now, [late, 0]),
            Level::High => self.write(Kind::Replenished, now, [left, 0]),
        }
        self.write(Kind::Level, now, [u64::from(level == Level::Low), left]);
    }
}

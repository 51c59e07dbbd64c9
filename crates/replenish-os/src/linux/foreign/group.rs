//! One budget and the threads that share it.
//!
//! The threads of a budget are one to its [`Reservation`]: their CPU times are added up, and their
//! switches are read in the order of time. The budget is blocked while all of them are.

use super::freezer::Brake;
use super::member::{Classes, Member};
use super::usage::BudgetUsage;
use crate::linux::blocked_intervals::BlockedIntervals;
use crate::linux::config::MAX_REPL;
use crate::linux::context_switches::SwitchDirection;
use crate::{Level, Nanos, Tid};
use sporadic::{BudgetServer, Kind, Params, Reservation, Server, Tuning};
use std::io;

/// The end of time, in the place of no time at all.
pub(super) const NEVER: Nanos = Nanos::MAX;

/// Switches of all threads of a budget between two readings; more count as lost.
pub(super) const MOST_EVENTS: usize = 4096;

/// Without budget for that long, if the period has the room: each change of the level is a system
/// call for every thread, and where they are stopped a signal to each as well.
const PAUSE: Nanos = 1_000_000;

/// A switch of one of the threads, by its place.
pub(super) type Event = (Nanos, usize, SwitchDirection);

/// One budget.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) members: Vec<Member>,
    pub(super) classes: Classes,
    /// The budget has ended: its place may be taken.
    pub(super) retired: bool,
    reservation: Reservation<Server<MAX_REPL>>,
    /// The budget of a period.
    amount: Nanos,
    /// From the end of the budget to the next raise at least, see [`pause`].
    pause: Nanos,
    /// The earliest time of the next raise.
    raise_at: Nanos,
    intervals: BlockedIntervals,
    /// CPU time of all threads, as the reservation counts it.
    cpu: Nanos,
    refused: u64,
    /// Places of the members in the order in which they are raised; kept for its memory.
    order: Vec<usize>,
    /// Stops its threads while there is no budget.
    brake: Option<Brake>,
}

impl Group {
    pub(super) fn new(
        params: Params,
        classes: Classes,
        tuning: Tuning,
        capacity: usize,
        now: Nanos,
    ) -> Self {
        let server = Server::clamped(Kind::Corrected, params, now).with_min_chunk(tuning.slack);
        Self {
            members: Vec::with_capacity(capacity),
            classes,
            retired: false,
            reservation: Reservation::new(server, tuning, now, 0),
            amount: params.budget(),
            pause: pause(&params),
            raise_at: 0,
            intervals: BlockedIntervals::new(),
            cpu: 0,
            refused: 0,
            order: Vec::with_capacity(capacity),
            brake: None,
        }
    }

    /// From now on its threads are stopped while there is no budget.
    pub(super) fn suspend_by(&mut self, brake: Brake) {
        brake.set(self.level());
        self.brake = Some(brake);
    }

    pub(super) fn level(&self) -> Level {
        self.reservation.level()
    }

    /// Time at which the next judgement is due, [`NEVER`] if none is.
    pub(super) fn check_at(&self) -> Nanos {
        if self.members.iter().all(|member| member.ended) {
            return NEVER; // the next thread that joins has it judged
        }
        let at = self.reservation.check_at().unwrap_or(NEVER);
        match self.level() {
            Level::High => at,
            Level::Low => at.max(self.raise_at),
        }
    }

    /// A thread is about to join. A budget without threads has waited up to now: counted as
    /// runnable, its first use would come back a period after an earlier time.
    pub(super) fn welcome(&mut self, now: Nanos, events: &mut Vec<Event>) {
        if self.members.iter().all(|member| member.ended) {
            self.read(now, events);
            let readings = self.intervals.readings();
            self.reservation.block(now, self.cpu, readings);
            self.intervals.restart(now);
            self.reservation.activate(now, now, self.cpu);
        }
        if self.level() == Level::High || now >= self.raise_at {
            self.judge(now, events);
        }
    }

    /// Reads all threads and decides. Returns whether the level changed.
    pub(super) fn judge(&mut self, now: Nanos, events: &mut Vec<Event>) -> bool {
        self.read(now, events);
        let verdict = self
            .reservation
            .judge(now, self.cpu, self.intervals.readings());
        let Some(level) = verdict.change else {
            return false;
        };
        self.take_turns();
        let refused = self.give_all(level);
        self.refused += refused;
        if refused > 0 {
            if level == Level::High {
                self.give_all(Level::Low); // none runs at the high priority uncounted
            }
            self.reservation.refused(now);
            return false;
        }
        // The overrun is debt already; single ones are not asked for here.
        self.reservation.applied(level, now, self.cpu);
        self.raise_at = now.saturating_add(self.pause);
        if let Some(brake) = &self.brake {
            brake.set(level);
        }
        true
    }

    /// The enforcer judges no more: all threads are in the background, and none is stopped.
    pub(super) fn abandon(&mut self, now: Nanos) {
        self.take_turns();
        self.give_all(Level::Low);
        self.reservation.applied(Level::Low, now, self.cpu);
        if let Some(brake) = self.brake.take() {
            brake.set(Level::High);
        }
    }

    /// Gives the threads a level, in their order; the number of refusals.
    fn give_all(&mut self, level: Level) -> u64 {
        let mut refused = 0;
        for &place in &self.order {
            if let Some(member) = self.members.get_mut(place).filter(|m| !m.ended) {
                refused += u64::from(member.give(level, self.classes).is_err());
            }
        }
        refused
    }

    /// At one priority the thread that is raised first runs first, until it waits. So the thread
    /// that has had least of the budget comes first. A thread that has waited, or has just joined,
    /// is at most one budget behind the others: it does not take several in a row.
    fn take_turns(&mut self) {
        let most = self.members.iter().map(|member| member.served).max();
        let least = most.unwrap_or(0).saturating_sub(self.amount);
        for member in &mut self.members {
            member.served = member.served.max(least);
        }
        let members = &self.members;
        let served = |place: &usize| members.get(*place).map(|member| member.served);
        self.order.clear();
        self.order.extend(0..members.len());
        self.order.sort_unstable_by_key(served);
    }

    /// See [`Reservation::pull_in`].
    pub(super) fn pull_in(&mut self, now: Nanos) {
        self.reservation.pull_in(now);
    }

    /// A budget whose threads have not had the CPU since they were read is as it was: its check
    /// counts from now. So one wake-up serves all budgets whose threads wait, or wait their turn.
    /// Reads memory alone.
    pub(super) fn catch_up(&mut self, now: Nanos) {
        let at = self.check_at();
        let idle = |member: &Member| member.ended || member.has_not_run();
        if at == NEVER || self.level() == Level::Low || !self.members.iter().all(idle) {
            return;
        }
        let left = self.reservation.server().available(now);
        if left > 0 {
            let due = now.saturating_add(left);
            self.reservation.postpone(due.saturating_sub(at));
        }
    }

    /// See [`Reservation::postpone`].
    pub(super) fn postpone(&mut self, by: Nanos) {
        self.reservation.postpone(by);
    }

    /// Brings the figures up to date without deciding.
    pub(super) fn observe(&mut self, now: Nanos, events: &mut Vec<Event>) {
        self.read(now, events);
        self.reservation
            .observe(now, self.cpu, self.intervals.readings());
    }

    /// Reads the switches and the CPU clocks of all threads.
    fn read(&mut self, now: Nanos, events: &mut Vec<Event>) {
        let (_, since) = self.reservation.last_reading();
        let level = self.level();
        let stopped = self.brake.is_some() && level == Level::Low;
        self.intervals.next_reading(since);
        events.clear();
        let (mut used, mut exact) = (0, true);
        let elapsed = now.saturating_sub(since);
        for (place, member) in self.members.iter_mut().enumerate() {
            if member.ended {
                continue;
            }
            let more = member.used(elapsed);
            member.charge(more, level);
            used += more;
            if let Some(log) = &mut member.log {
                let mut overflow = false;
                let drained = log.drain(&mut |mut switch| {
                    if let SwitchDirection::Out { preempted } = &mut switch.kind {
                        *preempted |= stopped; // it was stopped, and waits for nothing
                    }
                    if events.len() < MOST_EVENTS {
                        events.push((switch.time, place, switch.kind));
                    } else {
                        overflow = true;
                    }
                });
                if drained.lost || overflow {
                    member.lost();
                    exact = false;
                }
            } else {
                exact = false;
            }
        }
        if exact {
            self.feed(events);
        } else {
            for &mut (_, place, kind) in events {
                if let Some(member) = self.members.get_mut(place) {
                    member.switched(kind);
                }
            }
            self.intervals.lost(now);
        }
        self.cpu += used;
    }

    /// The switches of all threads as those of one: it blocks when the last of them does.
    fn feed(&mut self, events: &mut [Event]) {
        events.sort_unstable_by_key(|(time, ..)| *time);
        let awake = |member: &&Member| !member.ended && !member.blocked;
        let mut awake = self.members.iter().filter(awake).count();
        for &mut (time, place, kind) in events {
            let Some(member) = self.members.get_mut(place) else {
                continue;
            };
            let before = !member.blocked;
            member.switched(kind);
            let after = !member.blocked;
            awake = match (before, after) {
                (true, false) => awake.saturating_sub(1),
                (false, true) => awake + 1,
                _ => awake,
            };
            let kind = match kind {
                SwitchDirection::Out { .. } => SwitchDirection::Out {
                    preempted: awake > 0,
                },
                SwitchDirection::In => SwitchDirection::In,
            };
            let switch = crate::ContextSwitch { time, kind };
            self.intervals.feed(switch);
        }
    }

    /// Takes out a thread that has ended.
    pub(super) fn take_ended(&mut self) -> Option<Member> {
        let place = self.members.iter().position(|member| member.ended)?;
        Some(self.members.swap_remove(place))
    }

    /// Gives the newest thread its level; a thread that may not be changed leaves.
    pub(super) fn give_last(&mut self, level: Level, classes: Classes) -> io::Result<()> {
        let given = self
            .members
            .last_mut()
            .map(|last| last.give(level, classes));
        let given = given.unwrap_or(Ok(()));
        if given.is_err() {
            self.members.pop();
        }
        given
    }

    /// Takes out thread `tid`.
    pub(super) fn take(&mut self, tid: Tid) -> Option<Member> {
        let place = self.members.iter().position(|m| m.thread.tid() == tid)?;
        Some(self.members.swap_remove(place))
    }

    pub(super) fn usage(&self) -> BudgetUsage {
        let counters = self.reservation.counters();
        BudgetUsage {
            high: counters.cpu_high,
            background: counters.cpu_low,
            exhaustions: counters.exhaustions,
            replenishments: counters.replenishments,
            refused: self.refused,
            level: self.level(),
            threads: self.members.iter().filter(|member| !member.ended).count(),
            sees_blocking: self.members.iter().all(|member| member.log.is_some()),
        }
    }
}

/// From the end of a budget to the next raise at least: an eighth of the period or a millisecond.
///
/// A program that has waited often gets its budget back in pieces, and would be raised and lowered
/// for each of them in every period from then on. Pieces that come during the pause are used in one
/// go, and come back as one. A budget in one piece comes back later than that: three quarters of
/// the rest of the period are the most.
fn pause(params: &Params) -> Nanos {
    let rest = params.period().saturating_sub(params.budget());
    (params.period() / 8).max(PAUSE).min(rest - rest / 4)
}

//! A worker: one thread, one policy, its handles one after another.
//!
//! ```text
//!            bell rung, or a release               nothing ready, or the trigger waits for more
//!   waiting ────────────────────────► going round ──────────────────────────────────────► waiting
//!   (account blocked)                 (account active)
//! ```
//!
//! A round visits the handles in their order; each runs at most one callback per round (or as many
//! as `messages_per_round` says), for a sample or for a release that is due. So no handle of a
//! worker starves another, and within a round the order is the user's.
//!
//! A round looks at the handles that have got input or whose release has come ([`Agenda`]), so it
//! costs what its input costs, however many handles there are. Where the rules want to know of all
//! of them (a trigger other than any, Logical Execution Time, invocation without input) it looks at
//! each, whenever something new has come: input that is there already neither rings the bell again
//! nor is waited for.

use super::agenda::Agenda;
use super::doorbell::Doorbell;
use super::entry::{Entry, Tally};
use super::handle::Env;
use super::live::Live;
use super::mailbox::Mailbox;
use super::outbox::Outbox;
use super::rules::{HandleStates, Rules, Semantics, Trigger};
use super::schedule::{Schedule, nanos};
use super::stop::StopHandle;
use crate::Nanos;
use crate::event::Events;
use crate::sync::Arc;
use crate::text::shown;
use alloc::vec::Vec;
use core::cell::RefCell;
use replenish_os::Account;
use replenish_os::clock;

/// A worker's state; lives on its thread.
pub(crate) struct Worker {
    pub(crate) name: Arc<str>,
    pub(crate) bell: Arc<Doorbell>,
    pub(crate) stop: StopHandle,
    pub(crate) events: Arc<Events>,
    pub(crate) entries: Vec<Entry>,
    pub(crate) agenda: Agenda,
    /// Each round looks at every handle, since the rules want to know of all.
    pub(crate) looks_at_all: bool,
    pub(crate) rules: Rules,
    pub(crate) mailbox: Arc<Mailbox>,
    pub(crate) live: Option<Arc<Live>>,
    pub(crate) outbox: Option<RefCell<Outbox>>,
    /// When rounds begin, if by the clock alone.
    pub(crate) grid: Option<Schedule>,
    /// Callbacks that ran so far.
    pub(crate) ran: u64,
}

impl Worker {
    /// The executor starts at this instant, from which timers count.
    pub(crate) fn begin(&mut self, start: Nanos) {
        self.mailbox.open();
        if self.rules.every.is_some() {
            self.bell.mute();
        }
        self.grid = self.rules.every.map(|every| {
            let first = start.saturating_add(nanos(every.first_after));
            Schedule::new(first, nanos(every.period), every.overrun)
        });
        for entry in &mut self.entries {
            let line = self.mailbox.line(entry.slot);
            entry.handle.begin(start, &line);
        }
        self.reordered();
    }

    /// Handles have come or gone.
    pub(crate) fn reordered(&mut self) {
        // The usual case: nothing to be known in advance, each handle is looked at in its turn.
        let in_turn = matches!(self.rules.trigger, Trigger::Any)
            && self.rules.semantics == Semantics::TakeThenExecute
            && !self.entries.iter().any(|e| e.handling.always);
        self.looks_at_all = !in_turn;
        self.agenda.reorder(&self.entries);
    }

    /// Runs callbacks until a stop is requested.
    pub(crate) fn run(mut self, account: &mut Account, start: Nanos) {
        self.begin(start);
        let mut tally = Tally::new(account.meter());
        account.activate(start);
        while !self.stop.is_stopping() {
            self.mailbox.clone().empty(&mut self);
            if self.step(account, &mut tally) || self.bell.answer() {
                continue;
            }
            let release = self.next_wake();
            account.block();
            let woken = self.bell.wait(release);
            account.activate(woken);
        }
        account.block();
        self.end();
    }

    /// No callback runs any more.
    pub(crate) fn end(&mut self) {
        self.entries.iter_mut().for_each(Entry::abandon);
        self.mailbox.close();
    }

    /// A round, if it is time for one; whether it did anything.
    pub(crate) fn step(&mut self, account: &mut Account, tally: &mut Tally) -> bool {
        match &mut self.grid {
            None => self.round(account, tally),
            Some(grid) => match grid.serve(clock::monotonic()) {
                None => false,
                Some(_) => {
                    self.round(account, tally);
                    true
                }
            },
        }
    }

    /// After a round that did something: whether another one may find input that was there already.
    pub(crate) fn may_go_on(&self) -> bool {
        self.looks_at_all || self.agenda.is_due()
    }

    /// Visits every handle once, if the trigger allows it; whether any ran.
    pub(crate) fn round(&mut self, account: &mut Account, tally: &mut Tally) -> bool {
        let snapshot = self.rules.semantics == Semantics::LogicalExecutionTime;
        if self.looks_at_all && !self.is_triggered() {
            return false;
        }
        let env = Env {
            worker: &self.name,
            stop: &self.stop,
            events: &self.events,
            meter: &tally.meter.clone(),
            live: self.live.as_ref(),
            outbox: self.outbox.as_ref(),
        };
        let mut turn = Turn {
            env: &env,
            account,
            tally,
            batch: self.rules.batch.max(1),
            snapshot,
            ran: 0,
        };
        if snapshot {
            if !turn.may_begin() {
                return true;
            }
            for entry in self.entries.iter_mut().filter(|e| e.ready) {
                entry.snapshot(&env);
            }
        }
        let (mut last, mut from) = (None, 0);
        loop {
            let next = match self.looks_at_all {
                true => Some(from),
                false => {
                    self.agenda.release(clock::monotonic());
                    self.agenda.next_from(from)
                }
            };
            let entry = next.and_then(|at| Some((at, self.entries.get_mut(at)?)));
            let Some((position, entry)) = entry else {
                break;
            };
            from = position + 1;
            match turn.of(entry) {
                None => {
                    self.ran += turn.ran;
                    self.agenda.insert(position);
                    return true;
                }
                Some(ran) => last = ran.then_some(position).or(last),
            }
            if !self.looks_at_all {
                if entry.look(clock::monotonic()) {
                    self.agenda.insert(position);
                }
                let release = entry.handle.next_release();
                self.agenda.next_release_of(position, release);
            }
        }
        self.ran += turn.ran;
        if let Some(outbox) = &self.outbox {
            let to_blame = last.and_then(|at| self.entries.get(at));
            outbox.borrow_mut().release(|e| {
                if let Some(entry) = to_blame {
                    entry.shared.failed(shown(&e), env.events);
                }
            });
        }
        last.is_some() || (!self.looks_at_all && self.agenda.is_due())
    }

    /// Looks at every handle; whether what is there is enough for a round.
    fn is_triggered(&mut self) -> bool {
        let now = clock::monotonic();
        let (mut any, mut all) = (false, true);
        for entry in &mut self.entries {
            entry.ready = entry.look(now);
            any |= entry.ready;
            all &= entry.ready || !entry.is_live();
        }
        let states = HandleStates(&self.entries);
        match &mut self.rules.trigger {
            Trigger::Any => any,
            Trigger::All => any && all,
            Trigger::One(id) => states.is_ready(id),
            Trigger::Always => true,
            Trigger::Custom(condition) => any && condition(&states),
        }
    }

    /// When there will be something to do without the bell.
    pub(crate) fn next_wake(&mut self) -> Option<Nanos> {
        if let Some(grid) = &self.grid {
            return Some(grid.next());
        }
        if !self.looks_at_all {
            return self.agenda.earliest();
        }
        // A release that is due already waits for the trigger's other conditions, not for time.
        let overdue = match self.rules.trigger {
            Trigger::Any => 0,
            _ => clock::monotonic(),
        };
        let live = self.entries.iter_mut().filter(|e| e.is_live());
        let releases = live.filter_map(|e| e.handle.next_release());
        releases.filter(|at| *at > overdue).min()
    }
}

/// What the turns of one round share.
struct Turn<'r> {
    env: &'r Env<'r>,
    account: &'r mut Account,
    tally: &'r mut Tally,
    batch: u32,
    snapshot: bool,
    /// Callbacks so far.
    ran: u64,
}

impl Turn<'_> {
    /// Waits until a callback may begin; `false` if the executor stops.
    fn may_begin(&mut self) -> bool {
        let stop = self.env.stop;
        !stop.is_stopping() && self.account.callback_begin().is_ok() && !stop.is_stopping()
    }

    /// A handle's turn: as many callbacks as it may have in a round. Whether there were any;
    /// `None` if the executor stops.
    fn of(&mut self, entry: &mut Entry) -> Option<bool> {
        let mut ran = false;
        for n in 0..self.batch {
            let ready = match self.snapshot {
                true => entry.ready && entry.is_live(),
                false => entry.look(clock::monotonic()),
            };
            let without = n == 0 && entry.handling.always && entry.is_live();
            if !ready && !without {
                break;
            }
            if !self.may_begin() {
                return None;
            }
            ran = true;
            self.ran += 1;
            let took = entry.run(self.env, self.snapshot, without);
            self.account.callback_end();
            self.tally.settle(&entry.shared.counters);
            if !took {
                break;
            }
        }
        Some(ran)
    }
}

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
//! What a round costs a worker that may not begin it is one look at each handle whenever something
//! new has come: input that is there already neither rings the bell again nor is waited for.

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
            entry.handle.begin(start, &self.bell);
        }
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

    /// Visits every handle once, if the trigger allows it; whether any ran.
    pub(crate) fn round(&mut self, account: &mut Account, tally: &mut Tally) -> bool {
        let snapshot = self.rules.semantics == Semantics::LogicalExecutionTime;
        // The usual case: nothing to be known in advance, each handle is looked at in its turn.
        let in_turn = matches!(self.rules.trigger, Trigger::Any)
            && !snapshot
            && !self.entries.iter().any(|e| e.handling.always);
        if !in_turn && !self.is_triggered() {
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
        if snapshot {
            if account.callback_begin().is_err() || env.stop.is_stopping() {
                return true;
            }
            for entry in self.entries.iter_mut().filter(|e| e.ready) {
                entry.snapshot(&env);
            }
        }
        let batch = self.rules.batch.max(1);
        let (mut ran, mut last) = (false, None);
        for (at, entry) in self.entries.iter_mut().enumerate() {
            for n in 0..batch {
                let ready = match snapshot {
                    true => entry.ready && entry.is_live(),
                    false => entry.look(clock::monotonic()),
                };
                let without = n == 0 && entry.handling.always && entry.is_live();
                if !ready && !without {
                    break;
                }
                if env.stop.is_stopping() {
                    return true;
                }
                if account.callback_begin().is_err() || env.stop.is_stopping() {
                    return true;
                }
                (ran, last) = (true, Some(at));
                self.ran += 1;
                let took = entry.run(&env, snapshot, without);
                account.callback_end();
                tally.settle(&entry.shared.counters);
                if !took {
                    break;
                }
            }
        }
        if let Some(outbox) = &self.outbox {
            let to_blame = last.and_then(|at| self.entries.get(at));
            outbox.borrow_mut().release(|e| {
                if let Some(entry) = to_blame {
                    entry.shared.failed(&e, env.events);
                }
            });
        }
        ran
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

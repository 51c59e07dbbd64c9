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
//! A round looks at the handles that have got input or whose release has come (`RunQueue`), so it
//! costs what its input costs, however many handles there are. Where the rules want to know of all
//! of them (a trigger other than any, Logical Execution Time, invocation without input) it looks at
//! each, whenever something new has come: input that is there already neither rings the bell again
//! nor is waited for.

use super::accounting::CpuAccounting;
use super::state::{Intake, Worker, WorkerSpec};
use crate::Nanos;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::env::Env;
use crate::executor::wake::lazy_now::LazyNow;
use crate::platform::{DROPS, FULL, recorder};
use core::any::Any;
use replenish_os::{Account, Meter};

impl Worker {
    /// The executor starts at this instant, from which timers count.
    pub(crate) fn begin(&mut self, start: Nanos) {
        self.mailbox.open();
        if let Some(rounds) = self.spec.rules.rounds {
            (rounds.begin)(self, start);
        }
        for entry in &mut self.spec.entries {
            let wake = self.mailbox.wake_handle(entry.slot);
            entry.begin(start, &wake);
        }
        self.reordered();
    }

    /// Handles have come or gone.
    pub(crate) fn reordered(&mut self) {
        self.looks_at_all = self
            .spec
            .rules
            .rounds
            .is_some_and(|rounds| (rounds.want_all)(self));
        let mut slots = self.spec.entries.iter().map(|entry| entry.slot);
        self.run_queue.reorder(&mut slots);
    }

    /// Runs callbacks until a stop is requested. The account stays active: what the thread drops
    /// after that is under the budget as well.
    pub(crate) fn run(&mut self, account: &mut Account, start: Nanos) {
        self.begin(start);
        let accounting = CpuAccounting::new(account.meter());
        account.activate(start);
        while !self.stop.is_stopping() {
            self.empty_mailbox(account, &accounting);
            self.listen();
            if self.step(account, &accounting) || self.bell.take() {
                continue;
            }
            let release = self.next_wake();
            recorder::block();
            account.block();
            let woken = self.sleep(release);
            recorder::wake(woken.since, woken.awake);
            account.activate(woken.since);
        }
        self.end(account, &accounting);
    }

    /// Ends the worker: no callback runs any more. Drops what the callbacks own here, under the
    /// budget.
    pub(crate) fn end(&mut self, account: &mut Account, accounting: &CpuAccounting) {
        if let Some(rounds) = self.spec.rules.rounds {
            (rounds.end)(self);
        }
        self.mailbox.close();
        if DROPS {
            self.empty_mailbox(account, accounting);
            while let Some(mut entry) = self.spec.entries.pop() {
                self.empty(&mut entry, account, accounting);
            }
        }
    }

    /// Drops what a handle's callback owns, under the budget, and charges the handle for it.
    pub(super) fn empty(
        &self,
        entry: &mut HandleEntry,
        account: &mut Account,
        accounting: &CpuAccounting,
    ) {
        account.callback_begin().ok(); // a stop does not keep it from being dropped
        entry.empty(&self.env(&accounting.meter));
        account.callback_end();
        accounting.settle(&entry.shared.counters, entry.took);
    }

    fn env<'w>(&'w self, meter: &'w Meter) -> Env<'w> {
        Env {
            worker: &self.spec.request.name,
            stop: &self.stop,
            events: &self.events,
            meter,
            middleware: &*self.middleware,
            live: self.live.as_ref().map(|live| live as &dyn Any),
            outbox: self.outbox.as_ref(),
        }
    }

    /// A round, if it is time for one; whether it did anything. The dispatcher's thread brings
    /// input meanwhile.
    fn step(&mut self, account: &mut Account, accounting: &CpuAccounting) -> bool {
        self.step_with(account, accounting, &mut |_| ())
    }

    /// `step` with `intake` between callbacks: each sees samples that came during the one before.
    pub(crate) fn step_with(
        &mut self,
        account: &mut Account,
        accounting: &CpuAccounting,
        intake: Intake<'_>,
    ) -> bool {
        if let Some(rounds) = self.spec.rules.rounds {
            return (rounds.step)(self, account, accounting, intake);
        }
        match self.round::<false>(account, accounting, intake) {
            Ok(last) => last.is_some() || self.run_queue.is_due(),
            Err(Stopping) => true,
        }
    }

    /// After a round that did something: whether another one may find input that was there already.
    pub(crate) fn may_go_on(&mut self) -> bool {
        if self.spec.rules.is_unconditional() {
            return self.has_input();
        }
        self.looks_at_all || self.run_queue.is_due()
    }

    /// After a round in which another worker may have been rung: whether to look for that.
    pub(crate) fn may_have_been_rung(&mut self) -> bool {
        !self.spec.rules.is_unconditional() || self.has_input()
    }

    fn has_input(&mut self) -> bool {
        let now = LazyNow::default();
        let mut entries = self.spec.entries.iter_mut();
        entries.any(|entry| entry.look(&now)) || self.mailbox.is_waiting()
    }

    /// Carries out what other threads have asked of this worker.
    pub(crate) fn empty_mailbox(&mut self, account: &mut Account, accounting: &CpuAccounting) {
        while let Some(command) = self.mailbox.next() {
            self.apply(command, account, accounting);
        }
    }

    /// Visits each handle once that may have something to do, or with `ALL` those that had it when
    /// the round began; the position of the last one that ran.
    pub(crate) fn round<const ALL: bool>(
        &mut self,
        account: &mut Account,
        accounting: &CpuAccounting,
        intake: Intake<'_>,
    ) -> Result<Option<usize>, Stopping> {
        let spec: &mut WorkerSpec = &mut self.spec;
        let snapshot = ALL && spec.rules.takes_first();
        let env = Env {
            worker: &spec.request.name,
            stop: &self.stop,
            events: &self.events,
            meter: &accounting.meter,
            middleware: &*self.middleware,
            live: self.live.as_ref().map(|live| live as &dyn Any),
            outbox: self.outbox.as_ref(),
        };
        let mut turn = Turn {
            env: &env,
            account,
            accounting,
            batch: spec.rules.batch.unwrap_or(1),
            snapshot,
            ran: 0,
        };
        if snapshot {
            if !turn.may_begin() {
                return Err(Stopping);
            }
            for entry in spec.entries.iter_mut().filter(|e| e.ready) {
                entry.snapshot(&env);
            }
        }
        let (mut last, mut from) = (None, 0);
        loop {
            let next = if ALL {
                Some(from)
            } else {
                self.run_queue.release(&LazyNow::default());
                self.run_queue.next_from(from, self.bell.marks())
            };
            let entry = next.and_then(|at| Some((at, spec.entries.get_mut(at)?)));
            let Some((position, entry)) = entry else {
                break;
            };
            from = position + 1;
            if FULL && last.is_some() && !snapshot && (!ALL || entry.ready) {
                intake(turn.account);
            }
            match turn.of::<ALL>(entry) {
                None => {
                    self.ran += turn.ran;
                    self.run_queue.insert(position);
                    return Err(Stopping);
                }
                Some(ran) => last = ran.then_some(position).or(last),
            }
            if !ALL {
                if entry.look(&LazyNow::default()) || entry.has_more() {
                    self.run_queue.insert(position);
                }
                entry.handle.note_release(position, &mut self.run_queue);
            }
        }
        self.ran += turn.ran;
        Ok(last)
    }

    /// Time at which there will be something to do without the bell.
    pub(crate) fn next_wake(&mut self) -> Option<Nanos> {
        match self.spec.rules.rounds {
            Some(rounds) => (rounds.next_wake)(self),
            None => self.run_queue.earliest(),
        }
    }
}

/// The executor stops: a round ends where it is.
pub(crate) struct Stopping;

/// The values that the turns of one round share.
struct Turn<'r> {
    env: &'r Env<'r>,
    account: &'r mut Account,
    accounting: &'r CpuAccounting,
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
    fn of<const ALL: bool>(&mut self, entry: &mut HandleEntry) -> Option<bool> {
        let mut ran = false;
        for n in 0..self.batch {
            let snapshot = ALL && self.snapshot;
            if !ALL {
                entry.pull(self.env.events);
            }
            let ready = if snapshot {
                entry.ready && entry.is_live()
            } else {
                entry.look(&LazyNow::default())
            };
            let without = ALL && n == 0 && entry.handling.always && entry.is_live();
            if !ready && !without {
                break;
            }
            if !self.may_begin() {
                return None;
            }
            ran = true;
            self.ran += 1;
            let took = entry.run(self.env, snapshot, without);
            self.account.callback_end();
            let used = self.accounting.settle(&entry.shared.counters, entry.took);
            if FULL {
                entry.judge(used, self.env); // admission counts on it, and is there only then
            }
            if !took {
                break;
            }
        }
        Some(ran)
    }
}

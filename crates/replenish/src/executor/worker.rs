//! A worker: one thread, one policy, its handles one after another.
//!
//! ```text
//!            bell rung, or a timer's release                nothing ready
//!   waiting ─────────────────────────────────► going round ───────────────► waiting
//!   (account blocked)                          (account active)
//! ```
//!
//! A round visits the handles in the order they were added; each runs at most one callback per
//! round, for a sample or for a release that is due. So no handle of a worker starves another, and
//! within a round the order is the user's.

use super::doorbell::Doorbell;
use super::handle::{Env, Handle, Shared};
use super::stop::StopHandle;
use crate::Nanos;
use crate::event::{Event, Events};
use crate::stats::Counters;
use crate::stats::Text;
use crate::sync::{Arc, Ordering};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use core::any::Any;
use replenish_os::clock;
use replenish_os::{Account, Meter, Usage};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A handle on its worker's thread.
pub(crate) struct Entry {
    pub(crate) shared: Arc<Shared>,
    pub(crate) handle: Box<dyn Handle>,
    /// A callback panicked; the handle is left alone from then on.
    pub(crate) stopped: bool,
}

/// A worker's state; lives on its thread.
pub(crate) struct Worker {
    pub(crate) name: Arc<str>,
    pub(crate) bell: Arc<Doorbell>,
    pub(crate) stop: StopHandle,
    pub(crate) events: Arc<Events>,
    pub(crate) entries: Vec<Entry>,
}

impl Worker {
    /// Runs callbacks until a stop is requested. `start` is the instant timers count from.
    pub(crate) fn run(mut self, account: &mut Account, start: Nanos) {
        for entry in &mut self.entries {
            entry.handle.begin(start);
        }
        let mut tally = Tally::new(account.meter());
        account.activate(start);
        while !self.stop.is_stopping() {
            if self.round(account, &mut tally) || self.bell.answer() {
                continue;
            }
            let release = self.next_release();
            account.block();
            let woken = self.bell.wait(release);
            account.activate(woken);
        }
        account.block();
    }

    /// Visits every handle once; whether any ran.
    fn round(&mut self, account: &mut Account, tally: &mut Tally) -> bool {
        let env = Env {
            worker: &self.name,
            stop: &self.stop,
            events: &self.events,
        };
        let mut ran = false;
        for entry in self.entries.iter_mut().filter(|e| !e.stopped) {
            if !entry.handle.is_ready(clock::monotonic()) {
                continue;
            }
            if env.stop.is_stopping() {
                return true;
            }
            ran = true;
            if account.callback_begin().is_err() || env.stop.is_stopping() {
                return true;
            }
            let outcome = catch_unwind(AssertUnwindSafe(|| entry.handle.run(&env)));
            if let Err(panic) = outcome {
                entry.panicked(panic, &env);
            }
            account.callback_end();
            tally.settle(&entry.shared.counters);
        }
        ran
    }

    fn next_release(&self) -> Option<Nanos> {
        let running = self.entries.iter().filter(|e| !e.stopped);
        running.filter_map(|e| e.handle.next_release()).min()
    }
}

impl Entry {
    fn panicked(&mut self, panic: Box<dyn Any + Send>, env: &Env<'_>) {
        self.stopped = true;
        self.shared.counters.panicked.store(true, Ordering::Relaxed);
        let message = match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
            (Some(s), _) => s,
            (None, Some(s)) => s.as_str(),
            (None, None) => "(no message)",
        };
        *self.shared.last_error.lock() = Text::of(&message);
        let handle = &self.shared.id;
        env.events
            .emit(&Event::CallbackPanicked { handle, message });
        self.shared.discard(true, env.stop);
        core::mem::forget(panic); // dropping a payload may panic again
    }
}

/// Splits what the worker uses among its handles: whatever was used since the last callback ended
/// belongs to the one that just ended, the way there included.
struct Tally {
    meter: Meter,
    before: Usage,
}

impl Tally {
    fn new(meter: Meter) -> Self {
        let before = meter.usage();
        Self { meter, before }
    }

    fn settle(&mut self, counters: &Counters) {
        let now = self.meter.usage();
        let high = now.cpu_high.saturating_sub(self.before.cpu_high);
        let low = now.cpu_low.saturating_sub(self.before.cpu_low);
        counters.cpu_high.add(high);
        counters.cpu_background.add(low);
        counters.worst_execution.raise(high.saturating_add(low));
        let exhaustions = now.exhaustions.saturating_sub(self.before.exhaustions);
        counters.exhaustions.add(exhaustions);
        self.before = now;
    }
}

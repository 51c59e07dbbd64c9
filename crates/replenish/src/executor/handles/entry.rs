//! A handle on its worker: takes input, runs the callback, handles the outcome.

use super::deadline::Ended;
use super::env::Env;
use super::group::Held;
use super::handle::{Handle, Taken};
use super::options::HandleOptions;
use super::own_source::OwnSource;
use super::state::HandleState;
use crate::Nanos;
use crate::event::{Event, Events};
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::platform::chain::Links;
use crate::platform::{self, FULL, STD, ShortText, recorder};
use crate::sync::{Arc, Ordering};
use alloc::boxed::Box;
use replenish_os::clock;
use sporadic::since;

/// A handle on its worker's thread.
pub struct HandleEntry {
    pub(crate) shared: Arc<HandleState>,
    pub(crate) handle: Box<dyn Handle>,
    pub(crate) handling: HandleOptions,
    /// Its place among its worker's marks.
    pub(crate) slot: usize,
    /// The way of its samples, if its worker takes them itself.
    pub(crate) own: Option<Box<OwnSource>>,
    /// A callback panicked; the handle is left alone from then on.
    pub(crate) stopped: bool,
    /// Number of entries before this one that were added in the same call: one action has several.
    pub(crate) others: u8,
    /// It had something to do when the round began.
    pub(crate) ready: bool,
    /// The input taken when the round began (Logical Execution Time).
    taken: Option<Taken>,
    /// The next input that nobody awaits is left out: a deadline was missed.
    skip: bool,
    /// Time in ns from the start of the last callback to its end.
    pub(crate) took: Nanos,
    /// The thread's CPU clock when the callback began, where its group states a length.
    began: Nanos,
    /// Its places in chains.
    pub(crate) links: Links,
}

impl HandleEntry {
    pub(crate) fn new(shared: Arc<HandleState>, handle: Box<dyn Handle>) -> Self {
        Self {
            shared,
            handle,
            handling: HandleOptions::default(),
            slot: usize::MAX,
            own: None,
            stopped: false,
            others: 0,
            ready: false,
            taken: None,
            skip: false,
            took: 0,
            began: 0,
            links: Links::default(),
        }
    }

    /// The handle, for a handle around it.
    pub(crate) fn take_handle(&mut self) -> Box<dyn Handle> {
        core::mem::replace(&mut self.handle, Box::new(Empty))
    }

    /// Sets the options from now on.
    pub(crate) fn treat(&mut self, mut handling: HandleOptions) {
        handling.always |= self.handling.always;
        if let Some(hook) = handling.hook.take() {
            self.shared.hook.set(hook).ok();
        }
        self.handling = handling;
    }

    /// Discards input that was taken and will not run.
    pub(crate) fn abandon(&mut self) {
        if self.taken.take().is_some() && self.shared.input.is_some() {
            self.shared.counters.discarded.add(1);
        }
    }

    /// Whether it may run at all.
    pub(crate) fn is_live(&self) -> bool {
        !self.stopped && !self.shared.is_removed()
    }

    /// Its worker has it from now on.
    pub(crate) fn begin(&mut self, start: Nanos, wake: &WakeHandle) {
        if STD && let Some(own) = &mut self.own {
            own.begin();
        }
        self.handle.begin(start, wake);
    }

    /// Takes its new samples, if its worker receives them itself.
    pub(crate) fn pull(&mut self, events: &Events) {
        if STD && let Some(own) = &mut self.own {
            own.pull(events);
        }
    }

    /// Samples have come to it.
    pub(crate) fn heard(&mut self) {
        if STD && let Some(own) = &mut self.own {
            own.heard();
        }
    }

    /// Whether a pull may find samples.
    pub(crate) fn has_more(&self) -> bool {
        STD && self.own.as_ref().is_some_and(|own| own.has_more())
    }

    /// Whether it has something to do now.
    pub(crate) fn look(&mut self, now: &LazyNow) -> bool {
        self.is_live() && self.handle.is_ready(now)
    }

    /// Takes input for later.
    pub(crate) fn snapshot(&mut self, env: &Env<'_>) {
        self.guarded(env, |entry| entry.taken = entry.take(env));
    }

    /// Takes input, or what was taken when the round began, and runs the callback. With
    /// `even_without`, it runs without input, too. Whether there was any input.
    pub(crate) fn run(&mut self, env: &Env<'_>, from_snapshot: bool, even_without: bool) -> bool {
        self.took = 0;
        self.guarded(env, |entry| {
            let taken = if from_snapshot {
                entry.taken.take()
            } else {
                entry.take(env)
            };
            let runs = taken.is_some() || even_without;
            let group = entry.handling.group.clone().filter(|_| runs);
            let held = group.as_ref().map(|g| g.enter(&entry.shared, env));
            // A thread that waits for a lock may spin in the kernel: not the callback's time.
            if FULL && group.as_ref().is_some_and(|g| g.length() != 0) {
                entry.began = clock::thread_cpu();
            }
            let started = clock::monotonic();
            match taken {
                Some(taken) => entry.execute(env, taken, started, held),
                None if even_without => {
                    recorder::begin(entry.shared.name, started, started);
                    entry.handle.execute_empty(env, started);
                    let end = clock::monotonic();
                    recorder::end(end);
                    entry.took = since(end, started);
                    entry.shared.counters.without_input.add(1);
                }
                None => {}
            }
            taken.is_some()
        })
    }

    /// Judges the last callback by the CPU time `used` that it has taken.
    pub(crate) fn judge(&self, used: Nanos, env: &Env<'_>) {
        if let Some(group) = &self.handling.group
            && group.length() != 0
            && used.min(self.took) > group.length()
        {
            let held = clock::thread_cpu().saturating_sub(self.began);
            group.judge(&self.shared, held, env);
        }
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        let taken = self.handle.take(env)?;
        if !self.skip || self.handle.is_awaited() {
            return Some(taken);
        }
        self.skip = false;
        let counters = &self.shared.counters;
        recorder::skip(self.shared.name, 1);
        match self.shared.input {
            Some(_) => counters.discarded.add(1),
            None => counters.skipped.add(1),
        };
        None
    }

    /// `held`: its group, for as long as the callback runs.
    fn execute(&mut self, env: &Env<'_>, taken: Taken, started: Nanos, held: Option<Held<'_>>) {
        let counters = &self.shared.counters;
        let latency = since(started, taken.due);
        counters.worst_latency.raise(latency);
        self.shared.latency.record(latency);
        recorder::begin(self.shared.name, started, taken.due);
        self.links.begin(taken.due, started, &taken.provenance);
        self.handle.execute(env, started);
        drop(held);
        if self.handle.was_spoiled() {
            self.links.end(None, env.events);
            recorder::spoiled();
            return; // counted as such
        }
        counters.executed.add(1);
        let end = clock::monotonic();
        recorder::end(end);
        self.links.end(Some(end), env.events);
        self.took = since(end, started);
        let response = since(end, taken.due);
        self.shared.response.record(response);
        let Some(deadline) = self.handling.deadline.or(taken.deadline) else {
            return;
        };
        let ended = Ended {
            due: taken.due,
            response,
        };
        let (state, on_miss) = (&self.shared, &mut self.handling.on_miss);
        self.skip |= deadline.judge(ended, state, on_miss, env.stop);
    }

    /// Drops what the callback owns; a panic in that is the handle's.
    pub(crate) fn empty(&mut self, env: &Env<'_>) {
        let started = clock::monotonic();
        self.own = None; // nothing waits for it any more
        self.guarded(env, Self::drop_callback);
        self.guarded(env, Self::drop_options);
        self.took = clock::monotonic().saturating_sub(started);
    }

    fn drop_callback(&mut self) {
        drop(self.take_handle());
    }

    fn drop_options(&mut self) {
        drop(core::mem::take(&mut self.handling));
    }

    /// Runs the user's code; a panic stops the handle.
    fn guarded<T: Default>(&mut self, env: &Env<'_>, step: impl FnOnce(&mut Self) -> T) -> T {
        platform::guard(self, step, |entry, message| {
            entry.panicked(message, env);
            T::default()
        })
    }

    #[cold]
    fn panicked(&mut self, message: &str, env: &Env<'_>) {
        self.stopped = true;
        self.links.end(None, env.events);
        recorder::panicked(self.shared.name);
        self.shared.counters.panicked.store(true, Ordering::Relaxed);
        *self.shared.last_error.lock() = ShortText::of(&message);
        let handle = &self.shared.id;
        self.shared
            .report(1, &Event::CallbackPanicked { handle, message }, env.events);
        self.shared.discard(true, env.middleware);
    }
}

/// An entry whose callback has been dropped.
struct Empty;

impl Handle for Empty {
    fn is_ready(&mut self, _: &LazyNow) -> bool {
        false
    }
    fn take(&mut self, _: &Env<'_>) -> Option<Taken> {
        None
    }
    fn execute(&mut self, _: &Env<'_>, _: Nanos) {}
}

/// Guards the drop of an entry that was not [emptied](HandleEntry::empty), as in an executor that
/// never ran. A callback's values may panic as they are dropped. That must not end the thread, and
/// two of these panics must not end the process.
impl Drop for HandleEntry {
    fn drop(&mut self) {
        if STD {
            platform::guard(self, Self::drop_callback, |_, _| ());
            platform::guard(self, Self::drop_options, |_, _| ());
        }
    }
}

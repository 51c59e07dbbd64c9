//! Mutual exclusion across workers: callbacks of one group, one at a time.
//!
//! ```text
//!   worker A:  take ──► enter ── callback ── leave ──► counters, deadline
//!   worker B:  take ──► enter .............. waits ... callback ── leave
//!                        (A runs at B's priority meanwhile, if that is higher)
//! ```
//!
//! The rules that keep it free of deadlocks:
//!
//! - A handle is in one group at most, and callbacks do not nest, so no callback waits for a group
//!   while it holds another. Work that needs two groups needs one group instead, for all handles of
//!   both.
//! - Nothing of this crate waits in a callback for another callback: requests are answered by a
//!   callback, now or later ([`Responder`](crate::Responder)), and so are goals. Only a removal
//!   waits, and not while its callback is in a group: the worker it would wait for may wait for the
//!   group.
//! - A callback that waits by other means (a channel, a lock of its own) for a callback of its
//!   group waits for itself. No executor can forbid that, but it sees it: a worker that has waited
//!   for the group for [`Group::patience`] reports the names of both ([`Event::Blocked`]), and
//!   again whenever that time has doubled.
//!
//! A guarantee counts on the length of the critical sections for which its worker may wait
//! ([`Group::holds`]): admission refuses a group without, and so does a change while the executor
//! runs. A callback that takes longer is counted and reported.

use super::env::Env;
use super::state::HandleState;
use crate::Nanos;
use crate::event::Event;
use crate::executor::wake::schedule::nanos;
use crate::platform::recorder;
use crate::sync::{Arc, AtomicU64, Mutex, Ordering};
use alloc::string::String;
use core::fmt;
use core::time::Duration;
use replenish_os::{Tid, clock, current_tid};

/// Handles whose callbacks never run at the same time, on whatever workers they are: in
/// [`HandleOptions::group`](crate::HandleOptions::group). Clones are the same group.
///
/// The callback that runs while others wait inherits the highest of their priorities. On Linux its
/// worker pays for that time, and for what it uses after the end of its budget if it is to be
/// suspended: it is stopped after the callback, not in it. Waiting counts as blocking for a budget,
/// and as latency for the handle.
///
/// A worker with a guarantee may wait for each of the others, so its guarantee is admitted only if
/// they state [for how long](Self::holds), and run on the same CPU.
///
/// ```
/// use replenish::{Context, Executor, Group, HandleOptions};
/// use std::time::Duration;
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let arm = Group::new("arm");
/// for name in ["fast", "slow"] {
///     exec.worker(name)
///         .timer(Duration::from_millis(5), |_| ())?
///         .options(HandleOptions::new().group(&arm));
/// }
/// # Ok::<(), replenish::Error>(())
/// ```
#[derive(Clone)]
pub struct Group {
    pub(crate) inner: Arc<GroupInner>,
    /// The longest callback; 0: not stated.
    length: Nanos,
}

pub(crate) struct GroupInner {
    name: String,
    lock: Mutex<()>,
    patience: AtomicU64,
    /// Callbacks that took longer than stated.
    overruns: AtomicU64,
    /// The handle whose callback runs, and its thread.
    pub(crate) holder: Mutex<Option<(Tid, Arc<HandleState>)>>,
    ways: Ways,
}

/// Functions by which callbacks enter and leave. Workers call them through these pointers, so that
/// programs without groups do not carry their code.
struct Ways {
    enter: for<'g> fn(&'g Group, &Arc<HandleState>, &Env<'_>) -> Held<'g>,
    leave: fn(&Group),
    overrun: fn(&Group, &HandleState, Nanos, &Env<'_>),
}

/// The right to run, until dropped.
pub(crate) struct Held<'g> {
    group: &'g Group,
    _guard: replenish_os::PiMutexGuard<'g, ()>,
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        (self.group.inner.ways.leave)(self.group); // before the lock is free
    }
}

impl Group {
    /// A group without handles; the name is for people.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self {
            inner: Arc::new(GroupInner {
                name: name.into(),
                lock: Mutex::new(()),
                patience: AtomicU64::new(1_000_000_000),
                overruns: AtomicU64::new(0),
                holder: Mutex::new(None),
                ways: Ways {
                    enter: Self::wait,
                    leave: |group| *group.inner.holder.lock() = None,
                    overrun: Self::tell_overrun,
                },
            }),
            length: 0,
        }
    }

    /// States the longest time that a callback holds the group (its critical section): CPU time,
    /// and the time that it blocks meanwhile. The statement holds for the handles that get this
    /// clone, so that each can have its own. A worker with a rate guarantee has stated it by its
    /// execution time already.
    ///
    /// A guaranteed worker that shares the group waits that long at worst, which is part of the
    /// bound that admission tests. A callback that needs more CPU time goes on. It is
    /// [counted](Self::overruns), and an [event](Event::HeldTooLong) reports it.
    ///
    /// ```
    /// use replenish::{Group, HandleOptions};
    /// use std::time::Duration;
    /// let arm = Group::new("arm").holds(Duration::from_micros(200));
    /// let quick = HandleOptions::new().group(&arm);
    /// let slow = HandleOptions::new().group(&arm.clone().holds(Duration::from_millis(2)));
    /// # let _ = (quick, slow);
    /// ```
    #[must_use]
    pub fn holds(self, length: Duration) -> Self {
        Self {
            length: nanos(length).max(1),
            ..self
        }
    }

    /// Number of the group's callbacks that needed more CPU time than they [stated](Self::holds).
    #[must_use]
    pub fn overruns(&self) -> u64 {
        self.inner.overruns.load(Ordering::Relaxed)
    }

    /// Time that a callback may wait for the group before an [event](Event::Blocked) reports it.
    /// Default: 1 s. The callback goes on waiting. The time holds for all clones.
    #[must_use]
    pub fn patience(self, time: Duration) -> Self {
        let time = nanos(time).max(1);
        self.inner.patience.store(time, Ordering::Relaxed);
        self
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Waits until no callback of the group runs.
    pub(crate) fn enter(&self, shared: &Arc<HandleState>, env: &Env<'_>) -> Held<'_> {
        (self.inner.ways.enter)(self, shared, env)
    }

    fn wait(&self, shared: &Arc<HandleState>, env: &Env<'_>) -> Held<'_> {
        let inner = &self.inner;
        let guard = inner
            .lock
            .try_lock()
            .unwrap_or_else(|| self.queue(shared, env));
        *inner.holder.lock() = Some((current_tid(), Arc::clone(shared)));
        Held {
            group: self,
            _guard: guard,
        }
    }

    /// Waits for the callback that runs.
    fn queue(
        &self,
        shared: &Arc<HandleState>,
        env: &Env<'_>,
    ) -> replenish_os::PiMutexGuard<'_, ()> {
        let inner = &self.inner;
        let begin = clock::monotonic();
        let holder = inner.holder.lock().as_ref().map(|(_, handle)| handle.name);
        recorder::queue(shared.name, begin, holder);
        let mut patience = inner.patience.load(Ordering::Relaxed);
        loop {
            if let Some(guard) = inner.lock.lock_until(begin.saturating_add(patience)) {
                return guard;
            }
            self.tell(shared, clock::monotonic().saturating_sub(begin), env);
            patience = patience.saturating_mul(2);
        }
    }

    /// The stated length of a callback; 0: none.
    pub(crate) fn length(&self) -> Nanos {
        self.length
    }

    /// Counts and reports a callback that has taken more CPU time than the group states.
    pub(crate) fn judge(&self, shared: &HandleState, used: Nanos, env: &Env<'_>) {
        let length = self.length();
        if length != 0 && used > length {
            (self.inner.ways.overrun)(self, shared, used, env);
        }
    }

    #[cold]
    fn tell_overrun(&self, shared: &HandleState, held: Nanos, env: &Env<'_>) {
        let count = self.inner.overruns.fetch_add(1, Ordering::Relaxed) + 1;
        let event = Event::HeldTooLong {
            handle: &shared.id,
            group: self.name(),
            stated: self.length,
            held,
            count,
        };
        shared.report(count, &event, env.events);
    }

    #[cold]
    fn tell(&self, shared: &HandleState, waited: Nanos, env: &Env<'_>) {
        let holder = self
            .inner
            .holder
            .lock()
            .as_ref()
            .map(|(_, h)| Arc::clone(h));
        let event = Event::Blocked {
            handle: &shared.id,
            group: self.name(),
            by: holder.as_ref().map_or("-", |h| &h.id),
            waited,
        };
        shared.report(1, &event, env.events);
    }
}

impl fmt::Debug for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Group").field(&self.inner.name).finish()
    }
}

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
//! - A handle is in one group at most, and callbacks do not nest, so nobody waits for a group while
//!   he holds another. What needs two groups needs one group instead, for all handles of both.
//! - Nothing of this crate waits in a callback for another callback: requests are answered by a
//!   callback, now or later ([`Responder`](crate::Responder)), and so are goals. Only a removal
//!   waits, and not while its callback is in a group: the worker it would wait for may wait for the
//!   group.
//! - A callback that waits by other means (a channel, a lock of its own) for a callback of its
//!   group waits for itself. Nobody can forbid that, but it is seen: whoever has waited for the
//!   group for [`Group::patience`] tells so with the names of both ([`Event::Blocked`]), and tells
//!   again when that time has doubled.

use super::env::Env;
use super::state::HandleState;
use crate::Nanos;
use crate::event::Event;
use crate::executor::wake::schedule::nanos;
use crate::sync::{Arc, AtomicU64, Mutex, Ordering};
use alloc::string::String;
use core::fmt;
use core::time::Duration;
use replenish_os::{Tid, clock, current_tid};

/// Handles whose callbacks never run at the same time, on whatever workers they are: in
/// [`HandleOptions::group`](crate::HandleOptions::group). Clones are the same group.
///
/// Whoever runs while others wait inherits the highest of their priorities. Waiting counts as
/// blocking for a budget, and as latency for the handle.
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
    inner: Arc<Inner>,
}

struct Inner {
    name: String,
    lock: Mutex<()>,
    patience: AtomicU64,
    /// Whose callback runs, and on which thread.
    holder: Mutex<Option<(Tid, Arc<HandleState>)>>,
    ways: Ways,
}

/// How callbacks come in and go out: workers find it here, so that programs without groups do not
/// carry it.
struct Ways {
    enter: for<'g> fn(&'g Group, &Arc<HandleState>, &Env<'_>) -> Held<'g>,
    leave: fn(&Group),
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
            inner: Arc::new(Inner {
                name: name.into(),
                lock: Mutex::new(()),
                patience: AtomicU64::new(1_000_000_000),
                holder: Mutex::new(None),
                ways: Ways {
                    enter: Self::wait,
                    leave: |group| *group.inner.holder.lock() = None,
                },
            }),
        }
    }

    /// How long a callback may wait for the group until that is [told](Event::Blocked); 1 s if not
    /// said. It goes on waiting. Holds for all clones.
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
        let begin = clock::monotonic();
        let mut patience = inner.patience.load(Ordering::Relaxed);
        let guard = loop {
            if let Some(guard) = inner.lock.lock_until(begin.saturating_add(patience)) {
                break guard;
            }
            self.tell(shared, clock::monotonic().saturating_sub(begin), env);
            patience = patience.saturating_mul(2);
        };
        *inner.holder.lock() = Some((current_tid(), Arc::clone(shared)));
        Held {
            group: self,
            _guard: guard,
        }
    }

    /// Whether the caller is inside a callback of the group.
    #[cfg(feature = "full")]
    pub(crate) fn is_mine(&self) -> bool {
        let me = current_tid();
        let holder = self.inner.holder.lock();
        holder.as_ref().is_some_and(|(tid, _)| *tid == me)
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

/// The groups of an executor's handles.
#[cfg(feature = "full")]
#[derive(Default)]
pub(crate) struct Groups(Mutex<alloc::vec::Vec<Group>>);

#[cfg(feature = "full")]
impl Groups {
    /// A handle of it is about to come. Groups that nobody else has any more are forgotten.
    /// Allocates.
    pub(crate) fn note(&self, group: &Group) {
        let mut known = self.0.lock();
        known.retain(|g| Arc::strong_count(&g.inner) > 1);
        if !known.iter().any(|g| Arc::ptr_eq(&g.inner, &group.inner)) {
            known.push(group.clone());
        }
    }

    /// Whether the caller is inside a callback of one of them.
    pub(crate) fn has_mine(&self) -> bool {
        self.0.lock().iter().any(Group::is_mine)
    }
}

impl fmt::Debug for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Group").field(&self.inner.name).finish()
    }
}

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
//!   callback, now or later ([`Responder`](crate::Responder)), and so are goals. A callback that waits
//!   by other means (a channel, a lock of its own) for a callback of its group or its worker waits
//!   for itself; nobody can see that from outside.

use crate::sync::{Arc, Mutex};
use alloc::string::String;
use core::fmt;

/// Handles whose callbacks never run at the same time, on whatever workers they are: in
/// [`Handling::group`](crate::Handling::group). Clones are the same group.
///
/// Whoever runs while others wait inherits the highest of their priorities. Waiting counts as
/// blocking for a budget, and as latency for the handle.
///
/// ```
/// use replenish::{Context, Executor, Group, Handling};
/// use std::time::Duration;
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let arm = Group::new("arm");
/// for name in ["fast", "slow"] {
///     exec.worker(name)
///         .timer(Duration::from_millis(5), |_| ())?
///         .with(Handling::new().group(&arm));
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
}

/// The right to run, until dropped.
pub(crate) struct Held<'g> {
    _guard: replenish_os::PiMutexGuard<'g, ()>,
}

impl Group {
    /// A group without handles; the name is for people.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self {
            inner: Arc::new(Inner {
                name: name.into(),
                lock: Mutex::new(()),
            }),
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Waits until no callback of the group runs.
    pub(crate) fn enter(&self) -> Held<'_> {
        Held {
            _guard: self.inner.lock.lock(),
        }
    }
}

impl fmt::Debug for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Group").field(&self.inner.name).finish()
    }
}

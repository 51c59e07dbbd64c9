//! Guard conditions: any thread, or a signal handler, makes a worker call a callback.

use super::callback::{CallbackContext, CallbackResult};
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::handoff::Flag;
use crate::platform::chain::Provenance;
use crate::sync::{Arc, AtomicBool, AtomicU64, Once, Ordering, fence};
use core::fmt;
use replenish_os::clock;

/// Wakes a worker from anywhere. Clones are the same guard condition.
///
/// [`trigger`](Self::trigger) is async-signal-safe: atomic operations, a clock reading and one
/// system call, no lock, no allocation (POSIX.1-2017, XSH 2.4.3).
///
/// ```
/// use replenish::{Context, Executor, GuardCondition};
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let done = GuardCondition::new();
/// exec.worker("w").guard(&done, |cx| cx.stop())?;
/// let thread = std::thread::spawn(move || done.trigger());
/// exec.spin()?;
/// # thread.join().unwrap();
/// # Ok::<(), replenish::Error>(())
/// ```
#[derive(Clone)]
pub struct GuardCondition {
    inner: Arc<Inner>,
}

struct Inner {
    flag: Flag,
    /// Time at which it was triggered first since the last callback.
    since: AtomicU64,
    claimed: AtomicBool,
    wake: Once<WakeHandle>,
}

impl GuardCondition {
    /// A guard condition that belongs to no worker yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            inner: Arc::new(Inner {
                flag: Flag::new(),
                since: AtomicU64::new(0),
                claimed: AtomicBool::new(false),
                wake: Once::new(),
            }),
        }
    }

    /// Makes the callback run once more. Triggers that come before it has started count as one;
    /// their number is in [`CallbackContext::skipped`] and in the counters. A trigger before the
    /// executor starts is served when it does.
    pub fn trigger(&self) {
        let now = clock::monotonic();
        let inner = &self.inner;
        // Only the first of several keeps its time; losing a race here shifts a statistic.
        let unset = Ordering::Relaxed;
        inner.since.compare_exchange(0, now, unset, unset).ok();
        inner.flag.raise(|| {
            fence(Ordering::SeqCst); // either the wake handle is seen here, or the flag after `begin`
            if let Some(wake) = inner.wake.get() {
                wake.ring(now);
            }
        });
    }

    /// Claims the guard condition for a callback; `false` if it has belonged to one already.
    pub(crate) fn claim(&self) -> bool {
        !self.inner.claimed.swap(true, Ordering::AcqRel)
    }
}

impl Default for GuardCondition {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for GuardCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GuardCondition")
            .field("triggered", &self.inner.flag.is_raised())
            .finish_non_exhaustive()
    }
}

pub(crate) struct Guard<F> {
    shared: Arc<HandleState>,
    condition: GuardCondition,
    due: Nanos,
    skipped: u64,
    callback: F,
}

impl<F> Guard<F> {
    pub(crate) fn new(shared: Arc<HandleState>, condition: GuardCondition, callback: F) -> Self {
        Self {
            shared,
            condition,
            due: 0,
            skipped: 0,
            callback,
        }
    }
}

impl<F, R> Handle for Guard<F>
where
    F: FnMut(&CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, _start: Nanos, wake: &WakeHandle) {
        self.condition.inner.wake.set(wake.clone()).ok();
        fence(Ordering::SeqCst);
    }

    fn is_ready(&mut self, _now: &LazyNow) -> bool {
        self.condition.inner.flag.is_raised()
    }

    fn take(&mut self, _env: &Env<'_>) -> Option<Taken> {
        let inner = &self.condition.inner;
        let since = inner.since.swap(0, Ordering::Relaxed);
        let triggers = inner.flag.take();
        self.skipped = triggers.checked_sub(1)?;
        let counters = &self.shared.counters;
        counters.received.add(triggers);
        counters.skipped.add(self.skipped);
        self.due = match since {
            0 => clock::monotonic(),
            since => since,
        };
        Some(Taken {
            due: self.due,
            deadline: None,
            provenance: Provenance::default(),
        })
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let cx = CallbackContext {
            skipped: self.skipped,
            ..CallbackContext::new(env, &self.shared, self.due, started)
        };
        let result = (self.callback)(&cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}

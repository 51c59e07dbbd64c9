//! Timers: handles that are released by time alone, and the way to change them while they run.
//!
//! ```text
//!               cancel                       start
//!   ticking ──────────────► cancelled ──────────────► ticking, one period from now
//!      │ ▲                     ▲  ▲
//!      └─┘ start, set_period   │  └ not_started
//!      └── once, served ───────┘
//! ```
//!
//! A [`TimerHandle`] writes down what it wants under a lock and rings the worker, which does it
//! before it looks at the timer the next time. So only the worker touches the schedule.

use super::callback::{CallbackContext, CallbackResult};
use super::deadline::Deadline;
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::error::Error;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::run_queue::RunQueue;
use crate::executor::wake::schedule::{Every, Schedule, nanos};
use crate::platform::chain::Provenance;
use crate::platform::recorder;
use crate::sync::{Arc, AtomicBool, AtomicU64, Mutex, Once, Ordering, fence};
use core::fmt;
use core::time::Duration;
use replenish_os::clock;

/// Changes a timer while it runs, from any thread, callbacks included. Clones are the same timer.
///
/// ```
/// use replenish::{Context, Every, Executor, TimerHandle};
/// use std::time::Duration;
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let watchdog = TimerHandle::new();
/// let limit = Every::once(Duration::from_millis(5)).not_started();
/// exec.worker("w").timer_with(&watchdog, limit, |cx| cx.stop())?;
/// watchdog.start(); // fires 5 ms later, unless it is started again or cancelled
/// exec.spin()?;
/// # Ok::<(), replenish::Error>(())
/// ```
#[derive(Clone, Default)]
pub struct TimerHandle {
    inner: Arc<Control>,
}

#[derive(Default)]
pub(crate) struct Control {
    /// Even numbers of wishes, written down in `wish`.
    version: AtomicU64,
    wish: Mutex<Wish>,
    claimed: AtomicBool,
    wake: Once<WakeHandle>,
    /// The next release by the schedule's last answer.
    next: AtomicU64,
}

#[derive(Default, Clone, Copy)]
struct Wish {
    period: Option<Nanos>,
    /// `Some(Some(t))`: started at `t`; `Some(None)`: cancelled.
    run: Option<Option<Nanos>>,
}

impl TimerHandle {
    /// A handle for a timer that is yet to be added.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Starts the timer, or starts it over: its next release is one period from now.
    pub fn start(&self) {
        let now = clock::monotonic();
        self.wish(|w| w.run = Some(Some(now)));
    }

    /// Stops releases until [`start`](Self::start). A running callback goes on.
    pub fn cancel(&self) {
        self.wish(|w| w.run = Some(None));
    }

    /// Sets another period. It counts from the latest release, so a shorter one can be due at once.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a period of 0.
    pub fn set_period(&self, period: Duration) -> Result<(), Error> {
        if period == Duration::ZERO {
            return Err(Error::parameter("timer", "period", &0, "1 ns or more"));
        }
        self.wish(|w| w.period = Some(nanos(period)));
        Ok(())
    }

    /// The next release (`CLOCK_MONOTONIC`) as far as the worker has got; `None` if there is none.
    #[must_use]
    pub fn next_release(&self) -> Option<Nanos> {
        let next = self.inner.next.load(Ordering::Relaxed);
        Some(next).filter(|n| *n != Nanos::MAX && *n != 0)
    }

    fn wish(&self, change: impl FnOnce(&mut Wish)) {
        let inner = &self.inner;
        {
            let mut wish = inner.wish.lock();
            change(&mut wish);
            inner.version.fetch_add(1, Ordering::Release);
        }
        fence(Ordering::SeqCst); // either the wake handle is seen here, or the wish in `begin`
        if let Some(wake) = inner.wake.get() {
            wake.force();
        }
    }

    /// Claims this for a timer; `false` if it has belonged to one already.
    pub(crate) fn claim(&self) -> bool {
        !self.inner.claimed.swap(true, Ordering::AcqRel)
    }

    pub(crate) fn control(&self) -> Arc<Control> {
        Arc::clone(&self.inner)
    }
}

impl fmt::Debug for TimerHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TimerHandle")
            .field("next_release", &self.next_release())
            .finish_non_exhaustive()
    }
}

pub(crate) struct Timer<F> {
    shared: Arc<HandleState>,
    every: Every,
    schedule: Schedule,
    control: Option<Arc<Control>>,
    /// The version of the control's wishes that was fulfilled.
    seen: u64,
    skipped: u64,
    due: Nanos,
    callback: F,
}

impl<F> Timer<F> {
    pub(crate) fn new(
        shared: Arc<HandleState>,
        every: Every,
        control: Option<Arc<Control>>,
        callback: F,
    ) -> Self {
        Self {
            shared,
            every,
            schedule: Schedule::new(Nanos::MAX, nanos(every.period), every.overrun),
            control,
            seen: 0,
            skipped: 0,
            due: 0,
            callback,
        }
    }

    /// Does what the handle wants.
    fn obey(&mut self) {
        let Some(control) = &self.control else {
            return;
        };
        if control.version.load(Ordering::Acquire) != self.seen {
            let wish = {
                let mut wish = control.wish.lock();
                self.seen = control.version.load(Ordering::Acquire);
                core::mem::take(&mut *wish)
            };
            if let Some(period) = wish.period {
                self.schedule.change_period(period);
            }
            match wish.run {
                Some(Some(since)) => self.schedule.restart(since),
                Some(None) => self.schedule.cancel(),
                None => {}
            }
        }
        control.next.store(self.schedule.next(), Ordering::Relaxed);
    }
}

impl<F, R> Handle for Timer<F>
where
    F: FnMut(&CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, start: Nanos, wake: &WakeHandle) {
        if let Some(control) = &self.control {
            control.wake.set(wake.clone()).ok();
            fence(Ordering::SeqCst);
        }
        let first = if self.every.autostart {
            start.saturating_add(nanos(self.every.first_after))
        } else {
            Nanos::MAX
        };
        self.schedule = Schedule::new(first, nanos(self.every.period), self.every.overrun);
    }

    fn is_ready(&mut self, now: &LazyNow) -> bool {
        self.obey();
        !self.schedule.is_cancelled() && self.schedule.next() <= now.get()
    }

    fn next_release(&mut self) -> Option<Nanos> {
        self.obey();
        Some(self.schedule.next()).filter(|_| !self.schedule.is_cancelled())
    }

    fn note_release(&mut self, position: usize, run_queue: &mut RunQueue) {
        let release = self.next_release();
        run_queue.next_release_of(position, release);
    }

    fn take(&mut self, _env: &Env<'_>) -> Option<Taken> {
        let release = self.schedule.serve(clock::monotonic())?;
        if self.every.once {
            self.schedule.cancel();
        }
        self.shared.counters.skipped.add(release.skipped);
        if release.skipped > 0 {
            recorder::skip(self.shared.name, release.skipped);
        }
        self.skipped = release.skipped;
        self.due = release.at;
        let deadline = (!self.every.once).then(|| Deadline::of(self.schedule.period()));
        Some(Taken {
            due: release.at,
            deadline,
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

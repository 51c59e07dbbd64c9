//! Sleeping in a future of a worker, by steady time or by the time of a node.
//!
//! ```text
//!   sleep, sleep_until ──► Steady: the alarms of the future that is polled
//!   node.sleep         ──► Steady, or Simulated: woken by /clock; a jump backwards starts it over
//! ```

use super::clock::SimClock;
use crate::Nanos;
use crate::context::Node;
use crate::executor::nanos;
use crate::platform::sleeping::{Alarms, current};
use replenish_os::clock;
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

/// Time between two looks at `/clock`, in ns, for a sleep that found no place to be woken from.
const LOOK: Nanos = 10_000_000;

/// Waits for `time`, steady time, in a future of a worker.
///
/// For [`subscribe_async`](crate::WorkerBuilder::subscribe_async),
/// [`task`](crate::WorkerBuilder::task) and others. The worker runs its other handles meanwhile.
/// Nothing allocates. The time counts from now on, not from the first poll. In a future that no
/// worker polls, it blocks the thread.
///
/// ```
/// use replenish::{Context, Executor, sleep};
/// use std::time::Duration;
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let stop = exec.stop_handle();
/// exec.worker("blink").task(async move {
///     for _ in 0..3 {
///         sleep(Duration::from_millis(1)).await;
///     }
///     stop.stop();
/// })?;
/// exec.spin()?;
/// # Ok::<(), replenish::Error>(())
/// ```
pub fn sleep(time: Duration) -> Sleep {
    sleep_until(clock::monotonic().saturating_add(nanos(time)))
}

/// As [`sleep`], until an instant of `CLOCK_MONOTONIC` in nanoseconds.
///
/// [`CallbackContext::due`](crate::CallbackContext::due) gives such instants: for loops that keep
/// their grid.
pub fn sleep_until(instant: Nanos) -> Sleep {
    Sleep {
        until: Until::Steady(instant),
        alarm: None,
    }
}

impl Node {
    /// Waits for `time` of this node's time, in a future of a worker: as [`sleep`], or by `/clock`
    /// for a node with [`use_sim_time`](Self::uses_sim_time). The wait then counts from the first
    /// message, and starts over when the clock jumps backwards. Up to 64 such waits of a context
    /// are woken by `/clock`; further ones look at it every 10 ms.
    pub fn sleep(&self, time: Duration) -> Sleep {
        if !self.uses_sim_time() {
            return sleep(time);
        }
        let clock = self.context().sim_clock().clone();
        let seen = clock.now();
        let simulated = Simulated {
            due: seen.saturating_add(nanos(time)),
            time: nanos(time),
            place: None,
            seen,
            clock,
        };
        Sleep {
            until: Until::Simulated(simulated),
            alarm: None,
        }
    }
}

/// A wait that is awaited: [`sleep`], [`sleep_until`], [`Node::sleep`]. Dropping it gives it up.
#[must_use = "it waits when it is awaited"]
pub struct Sleep {
    until: Until,
    alarm: Option<Alarm>,
}

enum Until {
    Steady(Nanos),
    Simulated(Simulated),
}

struct Simulated {
    clock: SimClock,
    time: Nanos,
    due: Nanos,
    /// `/clock` when it was looked at last; 0 before the first message.
    seen: Nanos,
    place: Option<u64>,
}

/// Result of a look at `/clock`.
enum Look {
    Over,
    /// `/clock` wakes the future.
    Waits,
    /// The future has to be polled again after [`LOOK`].
    NoPlace,
}

/// A place among the alarms of a future.
struct Alarm {
    alarms: Arc<Alarms>,
    place: Option<u64>,
}

impl Drop for Alarm {
    fn drop(&mut self) {
        if let Some(place) = self.place {
            self.alarms.end(place);
        }
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        self.leave();
    }
}

impl Simulated {
    fn leave(&mut self) {
        if let Some(place) = self.place.take() {
            self.clock.forget(place);
        }
    }

    fn look(&mut self, cx: &Context<'_>) -> Look {
        loop {
            self.leave();
            let now = self.clock.now();
            if now < self.seen || self.seen == 0 {
                self.due = now.saturating_add(self.time);
            }
            self.seen = now;
            if now != 0 && now >= self.due {
                return Look::Over;
            }
            self.place = self.clock.remember(self.due, cx.waker());
            // A message that came before the place was taken has not woken this future.
            if self.clock.now() == now {
                return match self.place {
                    Some(_) => Look::Waits,
                    None => Look::NoPlace,
                };
            }
        }
    }
}

impl Sleep {
    /// Wakes the future at `due`, or blocks the thread that polls it outside of a worker.
    fn alarm(&mut self, due: Nanos, cx: &Context<'_>) -> Poll<()> {
        self.alarm = None;
        let Some(alarms) = current() else {
            clock::sleep_until(due);
            return Poll::Ready(());
        };
        let place = alarms.begin(due, cx.waker());
        self.alarm = Some(Alarm { alarms, place });
        Poll::Pending
    }
}

impl Future for Sleep {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let now = clock::monotonic();
        loop {
            let due = match &mut self.until {
                Until::Steady(due) if *due <= now => return Poll::Ready(()),
                Until::Steady(due) => *due,
                Until::Simulated(simulated) => match simulated.look(cx) {
                    Look::Over => return Poll::Ready(()),
                    Look::Waits => return Poll::Pending,
                    Look::NoPlace => clock::monotonic().saturating_add(LOOK),
                },
            };
            let polled = self.alarm(due, cx);
            if polled.is_pending() || matches!(self.until, Until::Steady(_)) {
                return polled;
            }
        }
    }
}

impl fmt::Debug for Sleep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sleep").finish_non_exhaustive()
    }
}

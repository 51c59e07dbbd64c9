//! ROS time of a simulation: the last value of `/clock`, and the timers that follow it. Pure but
//! for waits.
//!
//! ```text
//!   none yet ── first ──► runs ── later ──► runs: due timers are released
//!                          ▲                  │
//!                          └── earlier: each timer starts over
//! ```

use crate::Nanos;
use crate::executor::Every;
use crate::executor::wake::schedule::{Overrun, Schedule, nanos};
use crate::platform::sleeping::Places;
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use core::task::Waker;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex as PlainMutex, OnceLock, PoisonError};
use std::time::Duration;

/// The timer's side of a release.
pub(super) trait Release: Send {
    /// Releases the timer: it is due.
    fn release(&self);
    /// Whether the timer's callback is no more.
    fn is_gone(&self) -> bool;
}

/// The clock of one context's simulation. Clones are the same.
#[derive(Clone, Default)]
pub(crate) struct SimClock(Arc<Inner>);

#[derive(Default)]
struct Inner {
    /// In nanoseconds; 0 before the first message.
    now: AtomicU64,
    timers: Mutex<Vec<Timer>>,
    /// Futures that sleep, and until when.
    sleepers: Mutex<Places<SLEEPERS>>,
    /// Lock of the threads that wait: [`Rate`](super::time::Rate).
    turn: PlainMutex<()>,
    changed: Condvar,
    /// The first node that goes by it: the subscriber of `/clock`.
    follower: OnceLock<String>,
}

/// The most futures that a message wakes by themselves.
const SLEEPERS: usize = 64;

struct Timer {
    every: Every,
    schedule: Option<Schedule>,
    to: Box<dyn Release>,
}

impl Timer {
    fn start(&mut self, now: Nanos) {
        let first = now.saturating_add(nanos(self.every.first_after));
        let period = nanos(self.every.period);
        self.schedule = Some(Schedule::new(first, period, Overrun::Skip));
    }

    fn advance(&mut self, now: Nanos) {
        let Some(schedule) = &mut self.schedule else {
            return;
        };
        if schedule.serve(now).is_some() {
            if self.every.once {
                schedule.cancel();
            }
            self.to.release();
        }
    }
}

impl SimClock {
    /// `node` goes by it.
    pub(super) fn follow(&self, node: &str) {
        self.0.follower.get_or_init(|| node.into());
    }

    /// A node that goes by it.
    pub(super) fn follower(&self) -> Option<&str> {
        self.0.follower.get().map(String::as_str)
    }

    /// In nanoseconds; 0 before the first message.
    pub(super) fn now(&self) -> Nanos {
        self.0.now.load(Ordering::Acquire)
    }

    /// Sets another time, which may be earlier.
    pub(super) fn set(&self, now: Nanos) {
        let now = now.max(1);
        {
            let mut timers = self.0.timers.lock();
            let before = self.0.now.swap(now, Ordering::AcqRel);
            for timer in timers.iter_mut() {
                if before == 0 || now < before {
                    timer.start(now);
                }
                timer.advance(now);
            }
            self.wake_sleepers(before, now);
        }
        drop(self.0.turn.lock().unwrap_or_else(PoisonError::into_inner));
        self.0.changed.notify_all();
    }

    /// Wakes those that are due, and all of them where time begins or jumps backwards.
    fn wake_sleepers(&self, before: Nanos, now: Nanos) {
        let all = before == 0 || now < before;
        loop {
            let due = self.0.sleepers.lock().take_due(now, all);
            match due {
                Some(waker) => waker.wake(),
                None => return,
            }
        }
    }

    /// Wakes `waker` once when the time is `due`. The number of the sleep, to
    /// [forget](Self::forget) it; `None` if there is no place left.
    pub(super) fn remember(&self, due: Nanos, waker: &Waker) -> Option<u64> {
        self.0.sleepers.lock().begin(due, waker)
    }

    /// Gives up this sleep.
    pub(super) fn forget(&self, number: u64) {
        let forgotten = self.0.sleepers.lock().end(number);
        drop(forgotten);
    }

    /// A timer that begins now, or with the first message.
    pub(super) fn add(&self, every: Every, to: Box<dyn Release>) {
        let mut timer = Timer {
            every,
            schedule: None,
            to,
        };
        let mut timers = self.0.timers.lock();
        timers.retain(|timer| !timer.to.is_gone());
        match self.now() {
            0 => {}
            now => {
                timer.start(now);
                timer.advance(now);
            }
        }
        timers.push(timer);
    }

    /// Waits for the next change, no longer than `limit`.
    pub(super) fn wait(&self, seen: Nanos, limit: Duration) {
        let turn = self.0.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let same = |_: &mut ()| self.now() == seen;
        drop(self.0.changed.wait_timeout_while(turn, limit, same));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU32;

    struct Count(std::sync::Arc<AtomicU32>, bool);

    impl Release for Count {
        fn release(&self) {
            self.0.fetch_add(1, Ordering::SeqCst);
        }

        fn is_gone(&self) -> bool {
            self.1
        }
    }

    fn timer(clock: &SimClock, every: Every) -> impl Fn() -> u32 + use<> {
        let count = std::sync::Arc::new(AtomicU32::new(0));
        clock.add(every, Box::new(Count(std::sync::Arc::clone(&count), false)));
        move || count.load(Ordering::SeqCst)
    }

    const SECOND: Duration = Duration::from_secs(1);

    fn seconds(clock: &SimClock, at: u64) {
        clock.set(at * 1_000_000_000);
    }

    #[test]
    fn timers_follow_the_clock_forwards_and_backwards() {
        let clock = SimClock::default();
        let periodic = timer(&clock, SECOND.into());
        let once = timer(&clock, Every::once(2 * SECOND));
        assert_eq!((clock.now(), periodic()), (0, 0));
        seconds(&clock, 100); // the first message starts them
        assert_eq!((periodic(), once()), (0, 0));
        seconds(&clock, 101);
        seconds(&clock, 101);
        assert_eq!((periodic(), once()), (1, 0));
        seconds(&clock, 105); // several releases count as one
        assert_eq!((periodic(), once()), (2, 1));
        seconds(&clock, 50); // backwards: they start over
        assert_eq!((periodic(), once()), (2, 1));
        seconds(&clock, 51);
        assert_eq!(periodic(), 3);
        seconds(&clock, 52);
        assert_eq!((periodic(), once()), (4, 2));
        let late = timer(&clock, Every::period(SECOND).first_after(Duration::ZERO));
        assert_eq!(late(), 1);
    }

    #[test]
    fn timers_that_have_gone_take_no_room() {
        let clock = SimClock::default();
        for _ in 0..10 {
            let count = Count(std::sync::Arc::default(), true);
            clock.add(SECOND.into(), Box::new(count));
        }
        assert_eq!(clock.0.timers.lock().len(), 1);
    }

    #[test]
    fn a_wait_ends_with_a_change_or_its_limit() {
        let clock = SimClock::default();
        clock.wait(0, Duration::from_millis(1));
        let other = clock.clone();
        let thread = std::thread::spawn(move || other.wait(0, Duration::from_secs(3600)));
        clock.set(5);
        thread.join().unwrap();
    }
}

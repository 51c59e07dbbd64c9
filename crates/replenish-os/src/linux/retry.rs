//! A signal to the calling thread, some time from now: for a handler that could not do its work
//! where it was called.
#![expect(unsafe_code, reason = "timer_create, timer_settime, timer_delete")]

use super::tid::current_tid;
use crate::Nanos;
use std::ptr;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};

/// The first distance; it doubles while the thread stands still (it waits in a system call, which
/// each signal interrupts), and not while it runs.
const NEAR: Nanos = 20_000;
const FAR: Nanos = 10_000_000;

/// A timer of one thread, used and given back by that thread alone.
#[derive(Debug)]
pub(super) struct Retry {
    /// The result of `timer_create`; [`NONE`] without one.
    timer: AtomicPtr<libc::c_void>,
    /// The thread's CPU clock the last time, and how long it was given.
    cpu: AtomicU64,
    distance: AtomicU64,
}

/// No timer: kernels count them from 0, so that this one is never there.
const NONE: *mut libc::c_void = ptr::without_provenance_mut(usize::MAX);

impl Retry {
    pub(super) const fn new() -> Self {
        Self {
            timer: AtomicPtr::new(NONE),
            cpu: AtomicU64::new(0),
            distance: AtomicU64::new(NEAR),
        }
    }

    /// Makes the timer that sends `signal` to the calling thread. Where the kernel has none left,
    /// [`again`](Self::again) refuses.
    pub(super) fn prepare(&self, signal: libc::c_int) {
        if self.timer.load(Ordering::Relaxed) != NONE {
            return;
        }
        // SAFETY: all-zero is a valid sigevent.
        let mut event: libc::sigevent = unsafe { std::mem::zeroed() };
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_signo = signal;
        event.sigev_notify_thread_id = current_tid().get();
        let mut timer: libc::timer_t = ptr::null_mut();
        // SAFETY: `event` and `timer` live across the call.
        let rc =
            unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &raw mut event, &raw mut timer) };
        if rc == 0 {
            self.timer.store(timer, Ordering::Relaxed);
        }
    }

    /// The signal comes again, soon if the thread has run since the last time, by its CPU clock,
    /// `cpu`; otherwise later and later. Whether it will. Async-signal-safe.
    pub(super) fn again(&self, cpu: Nanos) -> bool {
        let timer = self.timer.load(Ordering::Relaxed);
        if timer == NONE {
            return false;
        }
        let distance = self.distance_after(cpu);
        let once = libc::itimerspec {
            it_interval: below_a_second(0),
            it_value: below_a_second(distance),
        };
        // SAFETY: the timer exists until `drop_timer`, which this thread calls at its end, outside
        // of handlers; `once` lives across the call.
        unsafe { libc::timer_settime(timer, 0, &raw const once, ptr::null_mut()) == 0 }
    }

    fn distance_after(&self, cpu: Nanos) -> Nanos {
        let ran = cpu.saturating_sub(self.cpu.swap(cpu, Ordering::Relaxed));
        let before = self.distance.load(Ordering::Relaxed);
        let distance = if ran >= before / 2 {
            NEAR
        } else {
            (before * 2).min(FAR)
        };
        self.distance.store(distance, Ordering::Relaxed);
        distance
    }

    /// Gives the timer back, at the end of its thread.
    pub(super) fn drop_timer(&self) {
        let timer = self.timer.swap(NONE, Ordering::Relaxed);
        if timer != NONE {
            // SAFETY: the timer exists; no thread finds it any more.
            unsafe { libc::timer_delete(timer) };
        }
    }
}

fn below_a_second(span: Nanos) -> libc::timespec {
    libc::timespec {
        tv_sec: 0,
        tv_nsec: libc::c_long::try_from(span).unwrap_or(0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread that runs through a long `memset` is found in the same place again and again. It
    /// counted as one that stands still, and had up to 10 ms more each time.
    #[test]
    fn only_a_thread_that_stands_still_is_left_alone_for_longer() {
        let retry = Retry::new();
        let mut cpu = 5_000_000;
        for _ in 0..100 {
            assert_eq!(retry.distance_after(cpu), NEAR);
            cpu += NEAR - 3_000;
        }
        // A system call that is interrupted costs a few microseconds itself.
        let mut last = 0;
        for _ in 0..20 {
            cpu += 4_000;
            last = retry.distance_after(cpu);
        }
        assert_eq!(last, FAR);
        assert_eq!(retry.distance_after(cpu + FAR), NEAR);
    }
}

//! POSIX CPU timers (`timer_create(2)` on a thread's CPU clock): what budgets could be enforced
//! with if the enforcer did not exist. `replenish bench enforcement` measures against them.
//!
//! The kernel looks at them at its tick, so they expire up to one tick late (4 ms at HZ=250).
#![expect(
    unsafe_code,
    reason = "timer_create, timer_settime, timer_delete, pthread_sigmask, sigtimedwait"
)]

use super::clock::ThreadCpuClock;
use super::sys::{self, NANOS_PER_SEC};
use super::tid::current_tid;
use crate::Nanos;
use crate::Tid;
use std::io;
use std::marker::PhantomData;

/// A one-shot timer on another thread's CPU clock that wakes the thread that made it.
///
/// Its expiry is a blocked real-time signal (`SIGRTMIN`) directed at that thread, taken by
/// [`wait`](Self::wait): no handler runs. Making one blocks the signal in the calling thread for
/// good. Bound to its thread, hence neither `Send` nor `Sync`.
#[derive(Debug)]
pub struct CpuTimer {
    id: libc::timer_t,
    signals: libc::sigset_t,
    bound_to_thread: PhantomData<*mut ()>,
}

impl CpuTimer {
    /// A disarmed timer on the CPU clock of thread `tid` of this process.
    ///
    /// # Errors
    /// `EINVAL` if the thread has ended, `EAGAIN` when the kernel has no room for a timer.
    pub fn new(tid: Tid) -> io::Result<Self> {
        let signals = signal_set();
        // SAFETY: `signals` is initialised; a null old set is allowed.
        let rc = unsafe {
            libc::pthread_sigmask(libc::SIG_BLOCK, &raw const signals, std::ptr::null_mut())
        };
        if rc != 0 {
            return Err(io::Error::from_raw_os_error(rc));
        }
        // SAFETY: all-zero is a valid sigevent.
        let mut event: libc::sigevent = unsafe { std::mem::zeroed() };
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_signo = libc::SIGRTMIN();
        event.sigev_notify_thread_id = current_tid().get();
        let mut id: libc::timer_t = std::ptr::null_mut();
        let clock = ThreadCpuClock::of(tid).id();
        // SAFETY: `event` and `id` live across the call.
        sys::check(unsafe { libc::timer_create(clock, &raw mut event, &raw mut id) })?;
        Ok(Self {
            id,
            signals,
            bound_to_thread: PhantomData,
        })
    }

    /// Expires once when the thread's CPU clock has reached `cpu`; replaces what was armed before.
    ///
    /// # Errors
    /// `ESRCH` or `EINVAL` if the thread has ended.
    pub fn arm(&self, cpu: Nanos) -> io::Result<()> {
        let spec = libc::itimerspec {
            it_interval: timespec(0),
            it_value: timespec(cpu.max(1)), // the kernel reads 0 as "disarm"
        };
        // SAFETY: the timer exists until drop; `spec` lives across the call.
        sys::check(unsafe {
            libc::timer_settime(
                self.id,
                libc::TIMER_ABSTIME,
                &raw const spec,
                std::ptr::null_mut(),
            )
        })?;
        Ok(())
    }

    /// Waits until the timer expires, at most `timeout` nanoseconds; returns whether it did.
    #[must_use]
    pub fn wait(&self, timeout: Nanos) -> bool {
        let ts = timespec(timeout);
        loop {
            // SAFETY: set and timeout live across the call; a null siginfo is allowed.
            let rc = unsafe {
                libc::sigtimedwait(&raw const self.signals, std::ptr::null_mut(), &raw const ts)
            };
            if rc != -1 {
                return true;
            }
            if io::Error::last_os_error().raw_os_error() != Some(libc::EINTR) {
                return false;
            }
        }
    }
}

impl Drop for CpuTimer {
    fn drop(&mut self) {
        // SAFETY: the timer exists and is deleted once. It cannot fail then.
        unsafe { libc::timer_delete(self.id) };
    }
}

fn timespec(t: Nanos) -> libc::timespec {
    libc::timespec {
        tv_sec: (t / NANOS_PER_SEC).try_into().unwrap_or(i32::MAX.into()),
        tv_nsec: libc::c_long::try_from(t % NANOS_PER_SEC).unwrap_or(0),
    }
}

/// The set with `SIGRTMIN` alone.
fn signal_set() -> libc::sigset_t {
    // SAFETY: sigemptyset initialises it before use; all-zero is a valid value to start from.
    let mut set: libc::sigset_t = unsafe { std::mem::zeroed() };
    // SAFETY: `set` is writable.
    unsafe { libc::sigemptyset(&raw mut set) };
    // SAFETY: `set` is initialised and the signal number valid.
    unsafe { libc::sigaddset(&raw mut set, libc::SIGRTMIN()) };
    set
}

#[cfg(test)]
mod tests {
    use super::super::clock;
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn it_expires_after_cpu_time_and_not_before() {
        static STOP: AtomicBool = AtomicBool::new(false);
        let (tx, rx) = std::sync::mpsc::channel();
        let spinner = std::thread::spawn(move || {
            tx.send(current_tid()).unwrap();
            while !STOP.load(Ordering::Relaxed) {
                std::hint::spin_loop();
            }
        });
        let tid = rx.recv().unwrap();
        let cpu = ThreadCpuClock::of(tid);
        let timer = CpuTimer::new(tid).unwrap();
        let at = cpu.read().unwrap() + 20_000_000;
        timer.arm(at).unwrap();
        let expired = timer.wait(10_000_000_000);
        let read = cpu.read().unwrap();
        STOP.store(true, Ordering::Relaxed);
        spinner.join().unwrap();
        assert!(expired);
        assert!(read >= at);
    }

    #[test]
    fn a_thread_that_does_not_run_lets_it_wait() {
        let (tx, rx) = std::sync::mpsc::channel();
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let sleeper = std::thread::spawn(move || {
            tx.send(current_tid()).unwrap();
            ended.recv().unwrap();
        });
        let tid = rx.recv().unwrap();
        let timer = CpuTimer::new(tid).unwrap();
        timer
            .arm(ThreadCpuClock::of(tid).read().unwrap() + 20_000_000)
            .unwrap();
        let before = clock::monotonic();
        assert!(!timer.wait(50_000_000));
        assert!(clock::monotonic() - before >= 50_000_000);
        end.send(()).unwrap();
        sleeper.join().unwrap();
    }
}

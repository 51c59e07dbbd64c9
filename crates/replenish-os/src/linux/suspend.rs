//! Stops an exhausted worker (`Low::Suspend`), and limits the priority that a lowered one inherits.
//!
//! A thread cannot be stopped from outside by POSIX means, so it stops itself in a signal handler
//! that the enforcer sends it into, below every real-time priority. It must not stop while it holds
//! one of our locks, or every waiter for that lock would wait for a replenishment, inheritance or
//! not: inside a critical section ([`PiMutex`](crate::PiMutex), and a group's callback is one) it
//! goes on in the time-sharing class, at the priority of a waiter if there is one, and stops as it
//! leaves the section. CPU time until then is a debt of the worker's budget.
//!
//! The C library has locks, too, and they inherit nothing: a thread that is interrupted in there
//! (`malloc`, `printf`) goes on in the time-sharing class for another 20 us, and again. One that
//! waits in there, in a system call, is given more time each time, up to 10 ms. Locks that it
//! cannot see are those of code that is linked into the program: `std::sync::Mutex`, Rust's
//! standard output, another allocator, a C library that is linked statically. A thread that waits
//! for one of them waits for the next replenishment of the stopped worker.
//!
//! While a program changes its user (`setuid`), the C library changes thread by thread. If the
//! enforcer's user differs from its worker's, the kernel refuses to lower the worker. A thread may
//! always lower itself: the handler does it then.
//!
//! ```text
//!   enforcer: lower, stop ─► signal ─► handler ── in the C library? ── yes: look again soon
//!                                         │ no
//!                                         ▼
//!                               suspension: sleep, or note it for the last unlock
//! ```
#![expect(unsafe_code, reason = "signal handler")]

use super::c_library;
use super::clock::{self, ThreadCpuClock};
use super::sched::{self, SchedClass};
use super::supervised::{self, SlotHandle};
use super::tid::current_tid;
use crate::{Nanos, Tid};
use std::ffi::{c_int, c_void};
use std::io;
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};

/// The signal has its handler; without one it would end the process.
static HANDLED: AtomicBool = AtomicBool::new(false);

/// One worker, as its enforcer stops, lowers and raises it.
#[derive(Debug)]
pub(crate) struct SuspendCell(SlotHandle);

impl SuspendCell {
    /// The worker of the calling thread, which can lower itself from now on. Allocates.
    pub(crate) fn new() -> Self {
        if install_handler().and_then(|()| unblock_signal()).is_ok() {
            HANDLED.store(true, Ordering::Release);
        }
        let mine = SlotHandle::mine();
        mine.suspension().renew();
        Self(mine)
    }

    /// Makes the calling thread one that can be stopped.
    pub(crate) fn attach_current_thread(&self) -> io::Result<()> {
        c_library::find();
        install_handler()?; // or what the kernel says
        self.0.retry().prepare(signal());
        Ok(())
    }

    /// Nothing to do: the place is the thread's for good, and no enforcer stops it any more.
    #[expect(clippy::unused_self, reason = "the other back ends' name")]
    pub(crate) const fn detach(&self) {}

    /// Stops the thread: at once if it is in a callback (`running`), else as it leaves a critical
    /// section, or before its next callback.
    ///
    /// # Errors
    /// The kernel's error if it refused to lower the priority. The thread is stopped all the same,
    /// outside sections, and lowers itself if it is in a callback.
    pub(crate) fn suspend(&self, tid: Tid, running: bool) -> io::Result<()> {
        self.0.suspension().stop();
        if running {
            // Before it is a time-sharing thread: the kernel's fair server prefers these to the
            // enforcer, and would let it work on for up to 50 ms.
            signal_thread(tid);
        }
        let lowered = sched::set_priority(tid, SchedClass::Other);
        if running && lowered.is_err() {
            self.0.demand().make(0);
            signal_thread(tid); // it may be through with the first one
        }
        lowered
    }

    /// The thread is at its background priority. It is stopped, too, once it has
    /// [inherited](Self::inherited) as much as `allowance`.
    pub(crate) fn lower(&self, allowance: Nanos) {
        self.0.suspension().lower(allowance);
    }

    /// The kernel refused to lower the thread to this priority, 0 being the time-sharing class: the
    /// thread does it itself, unless it is [resumed](Self::resume) before.
    pub(crate) fn lower_itself(&self, tid: Tid, low: u8) {
        if HANDLED.load(Ordering::Acquire) {
            self.0.demand().make(low);
            signal_thread(tid);
        }
    }

    /// The thread goes on. Its priority is the caller's to set, before.
    pub(crate) fn resume(&self) {
        self.0.demand().withdraw();
        self.0.suspension().raise();
    }

    /// As [`resume`](Self::resume), from a stop.
    ///
    /// # Errors
    /// The kernel's error if it refused to raise the priority. The thread goes on all the same.
    pub(crate) fn resume_at(&self, tid: Tid, priority: u8) -> io::Result<()> {
        let raised = sched::set_priority(tid, SchedClass::Fifo(priority));
        self.resume();
        raised
    }

    /// The executor stops: the thread finishes its callback, low as it may be.
    pub(crate) fn cancel(&self) {
        self.0.suspension().cancel();
    }

    /// Notes that a callback is about to begin; called by the thread itself.
    #[inline]
    pub(crate) fn wait_while_suspended(&self) {
        self.0.suspension().begin(clock::thread_cpu);
    }

    /// Whether the thread is stopped, or about to be: its wait is no block of its callback.
    pub(crate) fn is_stopped(&self) -> bool {
        self.0.suspension().is_asleep()
    }

    /// CPU time that the thread has used while others waited for it; its CPU clock shows `cpu`.
    pub(crate) fn inherited(&self, cpu: Nanos) -> Nanos {
        self.0.suspension().boosted(cpu)
    }

    /// The priority that the handler gives the thread.
    #[cfg(test)]
    pub(crate) fn taken_demand(&self) -> Option<u8> {
        self.0.demand().take()
    }

    #[cfg(test)]
    pub(crate) fn suspension(&self) -> &super::suspension::Suspension {
        self.0.suspension()
    }
}

/// A lock of ours is about to be taken by this thread.
#[inline]
pub(super) fn enter_critical() {
    if let Some(slot) = supervised::mine() {
        slot.suspension.enter();
    }
}

/// A lock of ours was released, or not taken; the last release obeys a stop that came meanwhile.
#[inline]
pub(super) fn leave_critical() {
    if let Some(slot) = supervised::mine() {
        slot.suspension.leave(clock::thread_cpu);
    }
}

/// The calling thread has a lock that others wait for.
pub(super) fn has_waiters() {
    if let Some(slot) = supervised::mine() {
        slot.suspension.boost_now(clock::thread_cpu());
    }
}

/// The calling thread is about to wait for a lock of thread `owner`, if `is_owner` still.
pub(super) fn waits_for(owner: i32, is_owner: impl Fn() -> bool) {
    if let Some(slot) = supervised::find(owner)
        && let Some(cpu) = Tid::new(owner).and_then(|tid| ThreadCpuClock::of(tid).read())
        && slot.suspension.boost(cpu)
        && !is_owner()
    {
        slot.suspension.boost_was_late(cpu);
    }
}

/// A real-time signal that neither libc nor common libraries use.
fn signal() -> c_int {
    libc::SIGRTMAX() - 3
}

/// A program that waits for its signals on one thread has blocked them all before it starts others.
fn unblock_signal() -> io::Result<()> {
    // SAFETY: all-zero is a valid set to fill in.
    let mut set: libc::sigset_t = unsafe { std::mem::zeroed() };
    // SAFETY: `set` lives across the call, which writes it alone.
    unsafe { libc::sigemptyset(&raw mut set) };
    // SAFETY: as above.
    unsafe { libc::sigaddset(&raw mut set, signal()) };
    // SAFETY: as above, and it only reads.
    match unsafe { libc::pthread_sigmask(libc::SIG_UNBLOCK, &raw const set, ptr::null_mut()) } {
        0 => Ok(()),
        error => Err(io::Error::from_raw_os_error(error)),
    }
}

fn signal_thread(tid: Tid) {
    let process = std::process::id();
    // SAFETY: tgkill takes plain numbers; a thread that has ended gives ESRCH.
    unsafe { libc::syscall(libc::SYS_tgkill, process, tid.get(), signal()) };
}

/// Async-signal-safe: a thread local without a destructor that enrolment has touched before, in
/// memory that is never freed; atomics; the system calls of scheduler, futex and timer.
extern "C" fn handler(_: c_int, _: *mut libc::siginfo_t, context: *mut c_void) {
    // SAFETY: errno is thread-local and always there; it is restored below.
    let errno = unsafe { libc::__errno_location() };
    // SAFETY: as above.
    let saved = unsafe { *errno };
    let mine = supervised::mine();
    if let Some(low) = mine.and_then(|slot| slot.demand.take()) {
        // Refused to a thread that others have changed: then the enforcer sees it.
        sched::demote_to_tail(current_tid(), low).ok();
    }
    if let Some(slot) = mine
        && slot.suspension.stops_here()
    {
        // SAFETY: the third argument of a handler installed with SA_SIGINFO.
        let place = unsafe { c_library::interrupted_at(context) };
        let in_library = place.filter(|place| c_library::contains(*place));
        if in_library.is_none() || !slot.retry.again(clock::thread_cpu()) {
            slot.suspension.wait();
        }
    }
    // SAFETY: as above.
    unsafe { *errno = saved };
}

fn install_handler() -> io::Result<()> {
    // SAFETY: an all-zero sigaction is a valid value to fill in.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    action.sa_sigaction = handler as *const () as libc::sighandler_t;
    action.sa_flags = libc::SA_RESTART | libc::SA_SIGINFO;
    // SAFETY: `action` is valid for the call; the handler has three arguments, as SA_SIGINFO says,
    // and is async-signal-safe.
    match unsafe { libc::sigaction(signal(), &raw const action, ptr::null_mut()) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

//! The low mode that stops an exhausted worker altogether (`Low::Suspend`).
//!
//! A thread cannot be suspended from outside by POSIX means, so it suspends itself in a signal
//! handler that the enforcer sends it into. It must not do so while it holds one of our locks,
//! or everybody behind that lock would wait for a replenishment, inheritance or not: inside
//! [`PiMutex`](crate::PiMutex) critical sections the handler only takes a note, and the last
//! unlock obeys it.
//!
//! ```text
//!  RUNNING ── suspend() + signal ──► SUSPENDED ── handler: futex wait ──┐
//!     ▲                                  │ in a critical section: later │
//!     └──────────── resume(): store, wake ◄─────────────────────────────┘
//! ```
//!
//! What it cannot know: locks of other libraries. A callback that is suspended inside `malloc`
//! keeps other threads from that arena. Prefer a background priority; suspend only callbacks
//! that share nothing.
#![expect(
    unsafe_code,
    reason = "signal handler, and a pointer in a thread local for it"
)]

use crate::Tid;
use crate::linux::futex;
use std::cell::Cell;
use std::io;
use std::ptr;
use std::sync::atomic::{AtomicU32, Ordering};

const RUNNING: u32 = 0;
const SUSPENDED: u32 = 1;

thread_local! {
    /// The word of the calling worker; null on every other thread.
    static WORD: Cell<*const AtomicU32> = const { Cell::new(ptr::null()) };
    /// How many of our locks the thread holds.
    static HELD: Cell<u32> = const { Cell::new(0) };
}

/// Tells one worker whether it is suspended.
#[derive(Debug)]
pub(crate) struct SuspendCell(AtomicU32);

impl SuspendCell {
    pub(crate) const fn new() -> Self {
        Self(AtomicU32::new(RUNNING))
    }

    /// Makes the calling thread one that can be suspended through this cell. The caller keeps the
    /// cell alive for as long as the thread runs (the enforcer's entry does).
    pub(crate) fn attach_current_thread(&self) -> io::Result<()> {
        install_handler()?;
        WORD.with(|w| w.set(&raw const self.0));
        Ok(())
    }

    /// The calling thread can no longer be suspended.
    pub(crate) fn detach_current_thread(&self) {
        if WORD.with(Cell::get) == &raw const self.0 {
            WORD.with(|w| w.set(ptr::null()));
        }
    }

    /// Suspends the thread: at once if it is in a callback (`running`), else before its next one.
    pub(crate) fn suspend(&self, tid: Tid, running: bool) {
        self.0.store(SUSPENDED, Ordering::SeqCst);
        if running {
            let process = std::process::id();
            // SAFETY: tgkill takes plain numbers; a thread that has ended gives ESRCH.
            unsafe { libc::syscall(libc::SYS_tgkill, process, tid.get(), signal()) };
        }
    }

    pub(crate) fn resume(&self) {
        if self.0.swap(RUNNING, Ordering::SeqCst) == SUSPENDED {
            futex::wake_one(&self.0);
        }
    }

    pub(crate) fn wait_while_suspended(&self) {
        wait(&self.0);
    }
}

fn wait(word: &AtomicU32) {
    while word.load(Ordering::SeqCst) == SUSPENDED {
        futex::wait(word, SUSPENDED, None);
    }
}

/// A lock of ours was taken by this thread.
#[inline]
pub(crate) fn enter_critical() {
    HELD.with(|h| h.set(h.get() + 1));
}

/// A lock of ours was released; the last release obeys a suspension that came meanwhile.
#[inline]
pub(crate) fn leave_critical() {
    let left = HELD.with(|h| {
        h.set(h.get().saturating_sub(1));
        h.get()
    });
    if left == 0 && !WORD.with(Cell::get).is_null() {
        suspend_here();
    }
}

/// Waits if the calling thread is a worker that is suspended.
fn suspend_here() {
    let word = WORD.with(Cell::get);
    if word.is_null() {
        return;
    }
    // SAFETY: set by `attach_current_thread` to a cell that outlives the thread's work.
    wait(unsafe { &*word });
}

/// A real-time signal that neither libc nor common libraries use.
fn signal() -> libc::c_int {
    libc::SIGRTMAX() - 3
}

extern "C" fn handler(_: libc::c_int) {
    // SAFETY: errno is thread-local and always there; it is restored below.
    let errno = unsafe { libc::__errno_location() };
    // SAFETY: as above.
    let saved = unsafe { *errno };
    if HELD.with(Cell::get) == 0 {
        suspend_here();
    }
    // SAFETY: as above.
    unsafe { *errno = saved };
}

fn install_handler() -> io::Result<()> {
    // SAFETY: an all-zero sigaction is a valid value to fill in.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    action.sa_sigaction = handler as *const () as libc::sighandler_t;
    action.sa_flags = libc::SA_RESTART;
    // SAFETY: `action` is valid for the call; the handler is async-signal-safe: thread locals
    // without destructors, atomics, the futex system call.
    match unsafe { libc::sigaction(signal(), &raw const action, ptr::null_mut()) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

//! A lock with priority inheritance: `FUTEX_LOCK_PI` with a fast path of one compare-and-swap.
//!
//! The futex word, as the kernel defines it:
//!
//! ```text
//!        lock: CAS                   another thread waits: kernel sets bit 31
//!   0 ───────────────► owner's tid ───────────────────────► tid | WAITERS
//!   ▲                     │ unlock: CAS                          │ unlock: FUTEX_UNLOCK_PI
//!   └─────────────────────┘◄───────────── new owner's tid ◄──────┘ (the highest waiter)
//! ```
//!
//! While a thread waits in the kernel, the owner runs at no less than that thread's priority,
//! through chains of locks too. A middle-priority thread can therefore not keep a high one
//! waiting longer than the critical section itself.
//!
//! The protocol is written over [`PiWord`], which is a word of memory and the kernel's two calls
//! here, and their model under `--cfg loom`.

use super::futex;
use super::suspend;
use super::tid::current_tid;
use crate::{Nanos, Tid};
use std::sync::atomic::{AtomicU32, Ordering};

/// Bit 31: a thread waits in the kernel.
pub(crate) const WAITERS: u32 = libc::FUTEX_WAITERS;
/// The bits of the owner's id.
pub(crate) const OWNER: u32 = libc::FUTEX_TID_MASK;

/// The futex word, and what the kernel does with it for the calling thread.
pub(crate) trait PiWord {
    /// The id of the calling thread.
    fn me() -> u32;
    fn load(&self) -> u32;
    /// Whether the word was `from`. In the one order of all such operations: see
    /// [`suspension`](super::suspension).
    fn swap(&self, from: u32, to: u32) -> bool;
    /// `FUTEX_LOCK_PI`, until then: 0, or the error number.
    fn wait(&self, deadline: Option<Nanos>) -> i32;
    /// `FUTEX_TRYLOCK_PI`: whether it was handed over to a less urgent thread that has not run
    /// since.
    fn seize(&self) -> bool;
    /// `FUTEX_UNLOCK_PI`: 0, or the error number.
    fn hand_over(&self) -> i32;
    /// The calling thread begins a critical section.
    fn enter();
    /// Notes that the thread ends a section, or has not got the lock.
    fn leave();
    /// The calling thread is about to wait for thread `owner`, unless `is_owner` is over.
    fn waits_for(owner: u32, is_owner: impl Fn() -> bool);
    /// The calling thread has the lock, and others wait for it.
    fn has_waiters();
}

/// Waits for the lock and takes it; panics where it would wait for ever.
#[inline]
pub(crate) fn lock<W: PiWord>(word: &W) {
    W::enter();
    if !word.swap(0, W::me()) {
        lock_slow(word, None);
    }
}

/// Whether it could be taken until then.
pub(crate) fn lock_until<W: PiWord>(word: &W, deadline: Nanos) -> bool {
    W::enter();
    word.swap(0, W::me()) || lock_slow(word, Some(deadline))
}

/// Whether it was free, or handed over to a less urgent thread that has not run since. Without the
/// latter, a thread that only tries may never get a lock that others pass to each other, and that
/// the kernel gives to whoever waits for it.
pub(crate) fn try_lock<W: PiWord>(word: &W) -> bool {
    W::enter();
    if word.swap(0, W::me()) {
        return true;
    }
    let seized = word.load() & WAITERS != 0 && word.seize();
    if !seized {
        W::leave();
    } else if word.load() & WAITERS != 0 {
        W::has_waiters();
    }
    seized
}

/// The thread that has the lock at this moment.
pub(crate) fn owner<W: PiWord>(word: &W) -> Option<Tid> {
    let owner = word.load() & OWNER;
    (owner != 0).then(|| Tid::known(owner.cast_signed()))
}

/// Waits; whether it has the lock, which it has if there is no deadline.
#[cold]
fn lock_slow<W: PiWord>(word: &W, mut deadline: Option<Nanos>) -> bool {
    loop {
        note_waiting(word);
        match word.wait(deadline) {
            0 => {
                if word.load() & WAITERS != 0 {
                    W::has_waiters(); // it was handed over, and more wait
                }
                return true;
            }
            // EAGAIN: the owner is about to exit; EINTR: the kernel restarts by itself on
            // most versions; ENOMEM: no kernel memory for the inheritance state just now.
            libc::EINTR | libc::EAGAIN | libc::ENOMEM => {}
            // Before Linux 5.14.
            libc::ENOSYS if deadline.is_some() => deadline = None,
            error => {
                W::leave(); // no guard will do it
                if error == libc::ETIMEDOUT && deadline.is_some() {
                    return false;
                }
                refuse(error)
            }
        }
    }
}

/// The owner's CPU clock is read before this thread waits, so that what the owner inherits can be
/// charged to it. Between this and the wait the lock may change hands unseen if this thread is
/// preempted there: then one section is not counted.
fn note_waiting<W: PiWord>(word: &W) {
    let owner = || word.load() & OWNER;
    let now = owner();
    if now != 0 {
        W::waits_for(now, || owner() == now);
    }
}

/// Unlocks; to be called by the owner.
#[inline]
pub(crate) fn unlock<W: PiWord>(word: &W) {
    if !word.swap(W::me(), 0) {
        let error = word.hand_over();
        debug_assert_eq!(error, 0, "FUTEX_UNLOCK_PI by the owner");
    }
    W::leave();
}

impl PiWord for AtomicU32 {
    fn me() -> u32 {
        current_tid().get().cast_unsigned()
    }

    fn load(&self) -> u32 {
        Self::load(self, Ordering::SeqCst)
    }

    #[inline]
    fn swap(&self, from: u32, to: u32) -> bool {
        self.compare_exchange(from, to, Ordering::SeqCst, Ordering::Relaxed)
            .is_ok()
    }

    fn wait(&self, deadline: Option<Nanos>) -> i32 {
        match deadline {
            Some(deadline) => futex::lock_pi_until(self, deadline),
            None => futex::lock_pi(self),
        }
    }

    fn seize(&self) -> bool {
        futex::trylock_pi(self)
    }

    fn hand_over(&self) -> i32 {
        futex::unlock_pi(self)
    }

    #[inline]
    fn enter() {
        suspend::enter_critical();
    }

    #[inline]
    fn leave() {
        suspend::leave_critical();
    }

    fn waits_for(owner: u32, is_owner: impl Fn() -> bool) {
        suspend::waits_for(owner.cast_signed(), is_owner);
    }

    fn has_waiters() {
        suspend::has_waiters();
    }
}

#[cold]
#[expect(
    clippy::panic,
    reason = "documented under # Panics: the alternative is to hang"
)]
fn refuse(error: i32) -> ! {
    match error {
        libc::EDEADLK => panic!("PiMutex: this thread holds the lock already, or a cycle of locks"),
        libc::ESRCH => panic!("PiMutex: the thread that holds the lock has ended"),
        _ => panic!(
            "PiMutex: FUTEX_LOCK_PI: {}",
            std::io::Error::from_raw_os_error(error)
        ),
    }
}

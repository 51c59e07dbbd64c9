//! Whether a thread is to stop, where it may, and what it had at a priority that it inherited: the
//! protocol between a budgeted thread, its signal handler, its enforcer and the threads that wait
//! for its locks.
//!
//! ```text
//!             lower, stop                        signal, in no critical section
//!   HIGH ───────────────────► LOW (| STOPPED) ──────────────────────────────► sleeps
//!    ▲                          │ in one: runs on, at the lowest priority        ▲
//!    │                          └─ leaves the last one, or begins a callback ────┤
//!    └──────────────────────────── raise: cleared, woken ◄───────────────────────┘
//!   CANCELLED: from then on nothing stops it
//! ```
//!
//! *Inherited time.* A thread that finds a lock taken notes the owner's CPU clock ([`Suspension::
//! boost`]) before it waits; the owner, leaving its last critical section, adds what it has used
//! since then. The enforcer reads the sum and charges the part of it that the owner used at its low
//! level. An owner that has used up its `allowance` in this way stops itself as it leaves.
//!
//! The thread that waits notes itself and then looks whether the owner still has the lock; the
//! owner gives it back and then looks whether a waiter has noted itself. All four are `SeqCst`, so
//! one of the two sees the other, and no note outlives its section.
//!
//! Only the thread itself writes `held` and `boosted`, and only it sleeps here. Its handler runs
//! between two of its instructions, hence the compiler's fences.

use crate::Nanos;
use crate::sync_shim::{AtomicBool, AtomicU32, AtomicU64, FutexWord, one_order};
use core::sync::atomic::{Ordering, compiler_fence};

/// The budget is used up: the low level.
const LOW: u32 = 1;
/// The thread is to stop as soon as it is in no critical section.
const STOPPED: u32 = 2;
/// Nothing stops the thread any more.
const CANCELLED: u32 = 4;

/// The known facts of one thread.
#[derive(Debug)]
pub(crate) struct Suspension {
    word: FutexWord,
    /// Number of our locks that the thread holds.
    held: AtomicU32,
    /// Number of locks that it held when its callback began: their guards were forgotten, or are
    /// kept.
    kept: AtomicU32,
    /// The thread sleeps here, or is about to.
    asleep: AtomicBool,
    /// The thread's CPU clock when another thread began to wait for it; 0 if none waits.
    boosted_since: AtomicU64,
    /// CPU time that the thread used while another waited for it, up to its last section.
    boosted: AtomicU64,
    /// The sum at which the thread, being low, stops at the end of its section.
    allowance: AtomicU64,
}

impl Suspension {
    pub(crate) fn new() -> Self {
        Self {
            word: FutexWord::new(0),
            held: AtomicU32::new(0),
            kept: AtomicU32::new(0),
            asleep: AtomicBool::new(false),
            boosted_since: AtomicU64::new(0),
            boosted: AtomicU64::new(0),
            allowance: AtomicU64::new(Nanos::MAX),
        }
    }

    /// The thread is enrolled, again perhaps: an earlier end is forgotten.
    pub(crate) fn renew(&self) {
        self.word.0.fetch_and(!CANCELLED, Ordering::SeqCst);
    }

    /// Makes the place as new, for another thread.
    pub(crate) fn reset(&self) {
        self.held.store(0, Ordering::Relaxed);
        self.kept.store(0, Ordering::Relaxed);
        self.boosted_since.store(0, Ordering::Relaxed);
        self.boosted.store(0, Ordering::Relaxed);
        self.allowance.store(Nanos::MAX, Ordering::Relaxed);
        self.word.0.store(0, Ordering::SeqCst);
    }

    // --- its own thread ---

    /// The thread is about to take a lock.
    #[inline]
    pub(crate) fn enter(&self) {
        let held = self.held.load(Ordering::Relaxed);
        self.held.store(held + 1, Ordering::Relaxed);
        // The handler must not find the lock taken and the section not begun.
        compiler_fence(Ordering::SeqCst);
    }

    /// The thread has given a lock back, or has not got it. After the last one it stops here if it
    /// is to. `cpu` reads its CPU clock.
    #[inline]
    pub(crate) fn leave(&self, cpu: impl FnOnce() -> Nanos) {
        compiler_fence(Ordering::SeqCst);
        // Saturating: the thread may have been enrolled with a lock held.
        let left = self.held.load(Ordering::Relaxed).saturating_sub(1);
        let kept = self.kept.load(Ordering::Relaxed).min(left);
        self.kept.store(kept, Ordering::Relaxed);
        let outermost = left == kept;
        if outermost {
            self.settle_boost(left > 0, cpu);
        }
        self.held.store(left, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        if outermost {
            self.wait();
        }
    }

    /// A callback is about to begin: the thread stops here if it is to. Locks that it still holds
    /// keep it from stopping no longer, but what it inherits through them goes on being counted.
    #[inline]
    pub(crate) fn begin(&self, cpu: impl FnOnce() -> Nanos) {
        let held = self.held.load(Ordering::Relaxed);
        self.kept.store(held, Ordering::Relaxed);
        self.settle_boost(held > 0, cpu);
        self.wait();
    }

    /// Adds the CPU time that the thread has used since a waiter noted itself. The waiter may wait
    /// on for a lock that is `kept`.
    #[inline]
    fn settle_boost(&self, kept: bool, cpu: impl FnOnce() -> Nanos) {
        one_order();
        if self.boosted_since.load(Ordering::SeqCst) == 0 {
            return;
        }
        let cpu = cpu();
        self.end_boost(cpu);
        if kept {
            self.boost_now(cpu);
        }
    }

    #[cold]
    fn end_boost(&self, cpu: Nanos) {
        let since = self.boosted_since.swap(0, Ordering::AcqRel);
        if since == 0 {
            return; // the waiter came too late, and has withdrawn its note
        }
        let sum = self.boosted.load(Ordering::Relaxed) + cpu.saturating_sub(since);
        self.boosted.store(sum, Ordering::Release);
        if sum >= self.allowance.load(Ordering::Acquire) {
            // Fails where the enforcer has raised the thread, or stopped it itself.
            let low = (LOW, LOW | STOPPED);
            let (success, failure) = (Ordering::SeqCst, Ordering::Relaxed);
            self.word
                .0
                .compare_exchange(low.0, low.1, success, failure)
                .ok();
        }
    }

    /// The thread holds a lock that others wait for.
    pub(crate) fn boost_now(&self, cpu: Nanos) {
        self.boosted_since.store(cpu.max(1), Ordering::Release);
    }

    /// In the signal handler: whether the thread is to stop, and may where it is. Not if it sleeps
    /// already: the handler has interrupted that.
    pub(crate) fn stops_here(&self) -> bool {
        !self.asleep.load(Ordering::Relaxed)
            && self.held.load(Ordering::Relaxed) == self.kept.load(Ordering::Relaxed)
            && stops(self.word.0.load(Ordering::SeqCst))
    }

    /// Sleeps for as long as the thread is stopped.
    #[inline]
    pub(crate) fn wait(&self) {
        if stops(self.word.0.load(Ordering::SeqCst)) {
            self.sleep();
        }
    }

    #[cold]
    fn sleep(&self) {
        self.asleep.store(true, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        loop {
            let word = self.word.0.load(Ordering::SeqCst);
            if !stops(word) {
                break;
            }
            self.word.wait(word, None);
        }
        compiler_fence(Ordering::SeqCst);
        self.asleep.store(false, Ordering::Relaxed);
        // A stop that came between the two was signalled in vain.
        if stops(self.word.0.load(Ordering::SeqCst)) {
            self.sleep();
        }
    }

    // --- its enforcer ---

    /// The thread is low. It stops once what it has used while others waited ([`boosted`](
    /// Self::boosted)) has reached `allowance`.
    pub(crate) fn lower(&self, allowance: Nanos) {
        self.allowance.store(allowance, Ordering::Release);
        self.word.0.fetch_or(LOW, Ordering::SeqCst);
    }

    /// The thread is low and stops. Signal it if it may be in a callback.
    pub(crate) fn stop(&self) {
        self.word.0.fetch_or(LOW | STOPPED, Ordering::SeqCst);
    }

    /// The thread goes on, at its high level.
    pub(crate) fn raise(&self) {
        let before = self.word.0.fetch_and(CANCELLED, Ordering::SeqCst);
        if before & STOPPED != 0 {
            self.word.wake_one();
        }
    }

    /// CPU time that the thread has used so far while another waited for it; `cpu` is its clock.
    pub(crate) fn boosted(&self, cpu: Nanos) -> Nanos {
        let sum = self.boosted.load(Ordering::Acquire);
        match self.boosted_since.load(Ordering::Acquire) {
            0 => sum,
            since => sum + cpu.saturating_sub(since),
        }
    }

    /// Whether the thread sleeps here, or is about to. It may do so at this moment.
    pub(crate) fn is_asleep(&self) -> bool {
        self.asleep.load(Ordering::Relaxed)
    }

    // --- a test in virtual time, in which nobody sleeps ---

    /// The end of a section, the last one. Whether the thread stops there.
    #[cfg(test)]
    pub(crate) fn end_section(&self, cpu: Nanos) -> bool {
        self.end_boost(cpu);
        self.is_stopped()
    }

    #[cfg(test)]
    pub(crate) fn is_stopped(&self) -> bool {
        stops(self.word.0.load(Ordering::SeqCst))
    }

    /// Whether nothing lowers or stops the thread.
    #[cfg(test)]
    pub(crate) fn is_free(&self) -> bool {
        self.word.0.load(Ordering::SeqCst) == 0
    }

    // --- any thread ---

    /// From now on nothing stops the thread.
    pub(crate) fn cancel(&self) {
        let before = self.word.0.fetch_or(CANCELLED, Ordering::SeqCst);
        if before & STOPPED != 0 {
            self.word.wake_one();
        }
    }

    /// The caller is about to wait for a lock that this thread holds. `cpu` is this thread's clock.
    /// Whether the caller is the first.
    pub(crate) fn boost(&self, cpu: Nanos) -> bool {
        let since = cpu.max(1);
        let first = self
            .boosted_since
            .compare_exchange(0, since, Ordering::SeqCst, Ordering::Relaxed)
            .is_ok();
        one_order();
        first
    }

    /// The thread did not hold the lock any more.
    pub(crate) fn boost_was_late(&self, cpu: Nanos) {
        let since = cpu.max(1);
        self.boosted_since
            .compare_exchange(since, 0, Ordering::AcqRel, Ordering::Relaxed)
            .ok();
    }
}

const fn stops(word: u32) -> bool {
    word & (STOPPED | CANCELLED) == STOPPED
}

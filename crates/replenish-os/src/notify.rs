//! The hand-off cell: one thread waits, any thread signals, nothing is lost.
//!
//! ```text
//!               set                        set (no system call)
//!   ┌───────┐ ───────────────────────────► ┌───────┐ ──┐
//!   │ EMPTY │                              │  SET  │   │ coalesces
//!   └───────┘ ◄─────────────────────────── └───────┘ ◄─┘
//!     │  ▲      wait returns (true)            ▲
//!     │  │ deadline passed                     │ set, then one futex wake
//!     ▼  │ (wait_until returns false)          │
//!   ┌─────────┐ ───────────────────────────────┘
//!   │ WAITING │   the waiter sleeps in the kernel while the word is WAITING
//!   └─────────┘
//! ```
//!
//! Why no wake-up is lost: the waiter announces itself (EMPTY to WAITING) before it sleeps, and
//! the kernel puts it to sleep only if the word is still WAITING. A signaller swaps in SET first
//! and looks at what it replaced. If it replaced WAITING, it wakes; if it came before the
//! announcement, the waiter finds SET and does not sleep. `modelled/loom_signal.rs` checks this
//! code in every interleaving.
//!
//! A waiter that waits for descriptors as well announces ELSEWHERE instead of WAITING, and sleeps
//! in a wait that the cell's own descriptor ends. That is written after the swap. So a waiter that
//! another descriptor woke may consume the set before, and the next wait ends early, once.
//!
//! The path from [`set`](Notify::set) to the waiter costs one swap and, if a thread waits, one
//! `FUTEX_WAKE`. Nothing allocates. Signal outside of locks: a waiter of higher priority runs at
//! once and would run into the lock.

use crate::Nanos;
use crate::sync_shim::{FutexWord, Woken};
use crate::wake_descriptor::WakeDescriptor;
use core::sync::atomic::Ordering;

const EMPTY: u32 = 0;
const SET: u32 = 1;
const WAITING: u32 = 2;
const ELSEWHERE: u32 = 3;

/// A cell that one thread waits on and any thread sets; several sets before a wait count once.
///
/// A thread's writes before [`set`](Self::set) are visible after the wait that this set ends,
/// also if several sets coalesced. At most one thread may wait at a time: with two, a set wakes
/// one of them and the other can sleep on until its deadline (a hang, not a data race).
#[derive(Debug)]
pub struct Notify {
    word: FutexWord,
    descriptor: WakeDescriptor,
}

impl Default for Notify {
    fn default() -> Self {
        Self::new()
    }
}

impl Notify {
    /// A cell that is not set.
    #[cfg(not(loom))]
    #[must_use]
    pub const fn new() -> Self {
        Self {
            word: FutexWord::new(EMPTY),
            descriptor: WakeDescriptor::new(),
        }
    }

    /// A cell that is not set; inside a `loom` model only.
    #[cfg(loom)]
    #[must_use]
    pub fn new() -> Self {
        Self {
            word: FutexWord::new(EMPTY),
            descriptor: WakeDescriptor::new(),
        }
    }

    /// Sets the cell and wakes the thread that waits, if one does. Never waits.
    pub fn set(&self) {
        // A swap, also over SET: consecutive swaps are one release sequence, through which the
        // waiter sees what every coalesced setter wrote.
        match self.word.0.swap(SET, Ordering::Release) {
            WAITING => self.word.wake_one(),
            ELSEWHERE => self.descriptor.wake(),
            _ => {}
        }
    }

    /// Consumes a set if there is one; never waits.
    #[cfg_attr(feature = "outlined", inline(never))]
    pub fn take(&self) -> bool {
        self.word
            .0
            .compare_exchange(SET, EMPTY, Ordering::Acquire, Ordering::Relaxed)
            .is_ok()
    }

    /// Waits until the cell is set and consumes the set.
    pub fn wait(&self) {
        self.wait_for(None);
    }

    /// Waits until the cell is set or [`monotonic`](crate::clock::monotonic) time has reached
    /// `deadline`. Returns whether it consumed a set: one that is there is taken also after the
    /// deadline.
    pub fn wait_until(&self, deadline: Nanos) -> bool {
        self.wait_for(Some(deadline))
    }

    /// The descriptor that a set makes readable while a thread waits in
    /// [`wait_elsewhere`](Self::wait_elsewhere). The waiter clears it. Made by the first call.
    ///
    /// # Errors
    /// `EMFILE` or `ENFILE` when no descriptor is free.
    #[cfg(all(target_os = "linux", not(nuttx_host), not(loom)))]
    pub fn descriptor(&self) -> std::io::Result<&crate::linux::poll::WakeFd> {
        self.descriptor.get()
    }

    /// A model waits for no descriptors.
    ///
    /// # Errors
    /// Always.
    #[cfg(loom)]
    pub fn descriptor(&self) -> std::io::Result<&crate::linux::poll::WakeFd> {
        Err(std::io::ErrorKind::Unsupported.into())
    }

    /// The model of the descriptor, to wait for.
    #[cfg(all(loom, test))]
    pub(crate) const fn modelled_descriptor(&self) -> &WakeDescriptor {
        &self.descriptor
    }

    /// Waits in `sleep`, which waits for descriptors and ends when this cell's `descriptor` is
    /// readable. Returns whether it consumed a set, and the value of `sleep`, which is not called
    /// if a set is there.
    ///
    /// The descriptor exists before the call. Without a set `sleep` may end early, for a set that
    /// an earlier wait has consumed.
    #[cfg(all(target_os = "linux", not(nuttx_host)))]
    pub fn wait_elsewhere<T>(&self, sleep: impl FnOnce() -> T) -> (bool, Option<T>) {
        let word = &self.word.0;
        // It fails only if a set came first: the word is never left announced.
        let announced =
            word.compare_exchange(EMPTY, ELSEWHERE, Ordering::Relaxed, Ordering::Relaxed);
        if announced.is_err() {
            return (self.take(), None);
        }
        let slept = sleep();
        let withdrawn =
            word.compare_exchange(ELSEWHERE, EMPTY, Ordering::Relaxed, Ordering::Relaxed);
        (withdrawn.is_err() && self.take(), Some(slept))
    }

    fn wait_for(&self, deadline: Option<Nanos>) -> bool {
        let word = &self.word.0;
        loop {
            if self.take() {
                return true;
            }
            // Announce the wait. This fails if a set came in between, or if the announcement of
            // an earlier round (after a spurious wake-up) still stands.
            let announced =
                word.compare_exchange(EMPTY, WAITING, Ordering::Relaxed, Ordering::Relaxed);
            if announced == Err(SET) {
                continue;
            }
            if self.word.wait(WAITING, deadline) == Woken::TimedOut {
                // Withdraw the announcement, or find the set that came with the deadline.
                let withdrawn =
                    word.compare_exchange(WAITING, EMPTY, Ordering::Relaxed, Ordering::Relaxed);
                return withdrawn.is_err() && self.take();
            }
        }
    }
}

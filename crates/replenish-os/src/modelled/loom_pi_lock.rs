//! Every interleaving of the lock with priority inheritance, over a model of the kernel's part: a
//! waiter is queued under the kernel's own lock, and an unlock hands over to the first in it.
#![allow(
    unsafe_code,
    clippy::unwrap_used,
    reason = "test code; plain memory under the lock"
)]

use super::tid::current_tid;
use crate::Nanos;
use crate::linux::pi_lock::{self, OWNER, PiWord, WAITERS};
use loom::cell::UnsafeCell;
use loom::sync::atomic::{AtomicU32, Ordering};
use loom::sync::{Arc, Condvar, Mutex};
use loom::thread;

fn model(f: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = builder.preemption_bound.or(Some(3));
    builder.check(f);
}

/// A futex word with its queue in the kernel. A wait with the deadline 0 is interrupted once by a
/// signal; one with any other is over as soon as others have had a chance to run.
struct Word {
    word: AtomicU32,
    queue: Mutex<Vec<u32>>,
    handed_over: Condvar,
}

impl Word {
    fn new() -> Self {
        Self {
            word: AtomicU32::new(0),
            queue: Mutex::new(Vec::new()),
            handed_over: Condvar::new(),
        }
    }

    /// `futex_lock_pi_atomic`: takes the word if no thread has it, else marks it.
    fn take_or_mark(&self) -> bool {
        loop {
            let word = self.word.load(Ordering::SeqCst);
            let new = match word & OWNER {
                0 => (word & WAITERS) | Self::me(),
                _ => word | WAITERS,
            };
            let (success, failure) = (Ordering::SeqCst, Ordering::Relaxed);
            let done = self.word.compare_exchange(word, new, success, failure);
            if done.is_ok() {
                return word & OWNER == 0;
            }
        }
    }
}

impl PiWord for Word {
    fn me() -> u32 {
        current_tid().get().cast_unsigned()
    }

    fn load(&self) -> u32 {
        self.word.load(Ordering::SeqCst)
    }

    fn swap(&self, from: u32, to: u32) -> bool {
        let (success, failure) = (Ordering::SeqCst, Ordering::Relaxed);
        let swapped = self.word.compare_exchange(from, to, success, failure);
        swapped.is_ok()
    }

    fn wait(&self, deadline: Option<Nanos>) -> i32 {
        let mut queue = self.queue.lock().unwrap();
        if self.word.load(Ordering::SeqCst) & OWNER == Self::me() {
            return libc::EDEADLK;
        }
        if self.take_or_mark() {
            return 0;
        }
        queue.push(Self::me());
        if deadline.is_some() {
            drop(queue);
            thread::yield_now();
            queue = self.queue.lock().unwrap();
            if self.word.load(Ordering::SeqCst) & OWNER == Self::me() {
                return 0; // handed over at the last moment
            }
            queue.retain(|waiter| *waiter != Self::me());
            return if deadline == Some(0) {
                libc::EINTR
            } else {
                libc::ETIMEDOUT
            };
        }
        while self.word.load(Ordering::SeqCst) & OWNER != Self::me() {
            queue = self.handed_over.wait(queue).unwrap();
        }
        0
    }

    fn seize(&self) -> bool {
        false // no thread of the model is more urgent than another
    }

    fn hand_over(&self) -> i32 {
        let mut queue = self.queue.lock().unwrap();
        let word = self.word.load(Ordering::SeqCst);
        if word & OWNER != Self::me() {
            return libc::EPERM;
        }
        let next = if queue.is_empty() { 0 } else { queue.remove(0) };
        let more = if queue.is_empty() { 0 } else { WAITERS };
        self.word.store(next | more, Ordering::SeqCst);
        self.handed_over.notify_all();
        0
    }

    fn enter() {}
    fn leave() {}
    fn waits_for(_: u32, is_owner: impl Fn() -> bool) {
        is_owner();
    }
    fn has_waiters() {}
}

struct Locked {
    word: Word,
    data: UnsafeCell<u32>,
}

// SAFETY: the data is touched under the lock, which is what the models check.
unsafe impl Sync for Locked {}
// SAFETY: as above.
unsafe impl Send for Locked {}

impl Locked {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            word: Word::new(),
            data: UnsafeCell::new(0),
        })
    }

    /// By the owner of the lock, who gives it back.
    fn add_and_unlock(&self) {
        // SAFETY: under the lock; `loom` reports any other access at the same time.
        self.data.with_mut(|data| unsafe { *data += 1 });
        pi_lock::unlock(&self.word);
    }

    /// After every thread has ended.
    fn is_free_with(&self, count: u32) {
        assert_eq!(self.word.load(), 0, "nobody has it, nobody waits");
        // SAFETY: no other thread is left.
        assert_eq!(self.data.with(|data| unsafe { *data }), count);
    }
}

fn others(n: usize, locked: &Arc<Locked>, f: fn(&Locked)) -> Vec<thread::JoinHandle<()>> {
    let spawn = |_| {
        let locked = locked.clone();
        thread::spawn(move || f(&locked))
    };
    (0..n).map(spawn).collect()
}

#[test]
fn loom_two_exclude_each_other_and_none_is_forgotten() {
    model(|| {
        let locked = Locked::new();
        let twice = |locked: &Locked| {
            for _ in 0..2 {
                pi_lock::lock(&locked.word);
                locked.add_and_unlock();
            }
        };
        let other = others(1, &locked, twice);
        twice(&locked);
        other.into_iter().for_each(|t| t.join().unwrap());
        locked.is_free_with(4);
    });
}

#[test]
fn loom_three_are_handed_the_lock_in_turn() {
    model(|| {
        let locked = Locked::new();
        let once = |locked: &Locked| {
            pi_lock::lock(&locked.word);
            locked.add_and_unlock();
        };
        let two = others(2, &locked, once);
        once(&locked);
        two.into_iter().for_each(|t| t.join().unwrap());
        locked.is_free_with(3);
    });
}

/// A waiter that gives up leaves the mark for waiters behind: the unlock finds that there is none.
#[test]
fn loom_a_waiter_that_gives_up_leaves_the_lock_usable() {
    model(|| {
        let locked = Locked::new();
        let other = others(1, &locked, |locked| {
            if pi_lock::lock_until(&locked.word, 1) {
                locked.add_and_unlock();
            }
        });
        pi_lock::lock(&locked.word);
        locked.add_and_unlock();
        let tried = pi_lock::try_lock(&locked.word);
        if tried {
            locked.add_and_unlock();
        }
        other.into_iter().for_each(|t| t.join().unwrap());
        assert_eq!(locked.word.load(), 0);
        assert!(pi_lock::try_lock(&locked.word), "nothing is left behind");
    });
}

/// An interrupted wait begins again and still ends with the lock.
#[test]
fn loom_an_interrupted_wait_begins_again() {
    model(|| {
        let locked = Locked::new();
        let other = others(1, &locked, |locked| {
            assert!(pi_lock::lock_until(&locked.word, 0));
            locked.add_and_unlock();
        });
        pi_lock::lock(&locked.word);
        locked.add_and_unlock();
        other.into_iter().for_each(|t| t.join().unwrap());
        locked.is_free_with(2);
    });
}

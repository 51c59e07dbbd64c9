//! Notices that wait until a participant's dispatcher takes them.

use crate::middleware::{IncompatibleQos, ReaderId};
use crate::sync::{Arc, AtomicBool, Mutex, Ordering};
use alloc::collections::VecDeque;

/// Notices that wait for one participant at most; more are left out.
const LIMIT: usize = 64;

/// The notices for one participant.
pub(super) struct Notices<T> {
    any: AtomicBool,
    waiting: Mutex<VecDeque<T>>,
}

/// Of endpoints that do not fit together.
pub(super) type Clashes = Notices<IncompatibleQos>;
/// Of samples that are longer than a reader takes, and how long they are.
pub(super) type Oversizes = Notices<(ReaderId, usize)>;

impl<T> Notices<T> {
    /// Nothing yet; with `room`, adding allocates nothing.
    pub(super) fn new(room: bool) -> Arc<Self> {
        let waiting = if room { LIMIT } else { 0 };
        Arc::new(Self {
            any: AtomicBool::new(false),
            waiting: Mutex::new(VecDeque::with_capacity(waiting)),
        })
    }

    /// Whether there was room for it.
    pub(super) fn add(&self, notice: T) -> bool {
        let mut waiting = self.waiting.lock();
        let room = waiting.len() < LIMIT;
        if room {
            waiting.push_back(notice);
            self.any.store(true, Ordering::Release);
        }
        room
    }

    pub(super) fn next(&self) -> Option<T> {
        if !self.any.load(Ordering::Acquire) {
            return None;
        }
        let mut waiting = self.waiting.lock();
        let next = waiting.pop_front();
        self.any.store(!waiting.is_empty(), Ordering::Release);
        next
    }
}

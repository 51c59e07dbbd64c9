//! Commands from any thread to one thread, and what that thread retires, to be freed elsewhere.
//!
//! ```text
//!   any thread                                   the commanded thread, between two steps
//!   reserve ─► slot ─► push(command) ─► commands ─► next: carries the command out
//!      ▲                                                │ what it uses no longer
//!      └──── free_retired: drops it ◄──── retired ◄─────┘ retire(slot)
//! ```
//!
//! Each slot is in one of these places, so the queue never grows. The commanded thread allocates
//! and frees nothing: memory is taken and given back by the threads that send commands.

use crate::sync::{AtomicBool, Mutex, Ordering};
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::ops::Range;

/// Commands `C` to one thread, which retires values `R`.
pub struct CommandQueue<C, R> {
    /// There are commands; written under the lock, so that a look costs none.
    waiting: AtomicBool,
    state: Mutex<State<C, R>>,
    limit: usize,
}

struct State<C, R> {
    commands: VecDeque<C>,
    retired: Vec<(usize, R)>,
    /// Slots that are neither reserved, nor in use, nor retired.
    free: Vec<usize>,
    closed: bool,
}

/// Why there is no slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Declined {
    /// All slots are in use, reserved or retired.
    Full {
        /// The number of slots.
        limit: usize,
    },
    /// The commanded thread has ended.
    Closed,
}

/// A slot for one command; free again when dropped without one.
pub struct Reservation<'q, C, R> {
    queue: &'q CommandQueue<C, R>,
    slot: usize,
}

impl<C, R> Drop for Reservation<'_, C, R> {
    fn drop(&mut self) {
        self.queue.state.lock().free.push(self.slot);
    }
}

impl<C, R> Reservation<'_, C, R> {
    /// The slot.
    #[must_use]
    pub const fn slot(&self) -> usize {
        self.slot
    }

    /// Sends a command, which takes the slot over.
    ///
    /// # Errors
    /// The command, if the commanded thread has ended.
    pub fn push(self, command: C) -> Result<(), C> {
        self.queue.push(command)?;
        core::mem::forget(self); // the commanded thread retires the slot
        Ok(())
    }
}

impl<C, R> CommandQueue<C, R> {
    /// For the slots `free` out of `free.end`, with room for `commands` that wait.
    ///
    /// Allocates here only.
    #[must_use]
    pub fn new(free: Range<usize>, commands: usize) -> Self {
        let limit = free.end;
        Self {
            waiting: AtomicBool::new(false),
            state: Mutex::new(State {
                commands: VecDeque::with_capacity(commands),
                retired: Vec::with_capacity(limit),
                free: free.rev().collect(),
                closed: false,
            }),
            limit,
        }
    }

    /// Reserves a slot, before any step that a command must follow.
    ///
    /// # Errors
    /// If there is none, or the commanded thread has ended.
    pub fn reserve(&self) -> Result<Reservation<'_, C, R>, Declined> {
        let mut state = self.state.lock();
        if state.closed {
            return Err(Declined::Closed);
        }
        let limit = self.limit;
        let slot = state.free.pop().ok_or(Declined::Full { limit })?;
        Ok(Reservation { queue: self, slot })
    }

    /// Sends a command that needs no slot of its own. The caller then wakes the commanded thread.
    ///
    /// # Errors
    /// The command, to be dropped where that does no harm, if the commanded thread has ended.
    pub fn push(&self, command: C) -> Result<(), C> {
        let mut state = self.state.lock();
        if state.closed {
            return Err(command);
        }
        state.commands.push_back(command);
        self.waiting.store(true, Ordering::Release);
        Ok(())
    }

    /// Drops what was retired, outside the lock; the slots are free again.
    pub fn free_retired(&self) {
        loop {
            let retired = {
                let mut state = self.state.lock();
                let retired = state.retired.pop();
                state.free.extend(retired.as_ref().map(|(slot, _)| slot));
                retired
            };
            if retired.is_none() {
                return;
            }
        }
    }

    /// Commanded thread: whether a command waits.
    pub fn is_waiting(&self) -> bool {
        self.waiting.load(Ordering::Acquire)
    }

    /// Commanded thread: the oldest command.
    pub fn next(&self) -> Option<C> {
        if !self.is_waiting() {
            return None;
        }
        let mut state = self.state.lock();
        let command = state.commands.pop_front();
        let more = !state.commands.is_empty();
        self.waiting.store(more, Ordering::Relaxed);
        command
    }

    /// Commanded thread: does not use `unused` and its slot any more. `tell` runs before another
    /// thread can free them.
    pub fn retire(&self, slot: usize, unused: R, tell: impl FnOnce(&R)) {
        let mut state = self.state.lock();
        tell(&unused);
        state.retired.push((slot, unused));
    }

    /// Commanded thread: it ends. `left` sees each command that nobody carries out any more.
    pub fn close(&self, left: impl FnMut(&C)) {
        let mut state = self.state.lock();
        state.closed = true;
        state.commands.iter().for_each(left);
    }
}

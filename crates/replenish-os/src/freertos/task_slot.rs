//! The state of each task in this back end, kept up to date by the kernel's switch hooks.
//!
//! ```text
//!   loses the CPU, in its ready list ──► preempted: cpu += now - in_at
//!   loses the CPU, not in it         ──► blocked:   cpu += now - in_at, an interval opens
//!   gets the CPU, at the same now    ──► in_at = now, an open interval is complete
//! ```
//!
//! Slots are made at set-up, linked into one list and never freed. Time in interrupts counts for
//! the task they interrupt.
#![expect(
    unsafe_code,
    reason = "hooks get slots as pointers; the list's end is one"
)]

use super::ffi::Task;
use crate::Nanos;
use crate::rtos::blocked_intervals::BlockedIntervals;
use crate::rtos::critical_section::{CriticalSection, Guarded};
use alloc::boxed::Box;
use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use sporadic::{later, since};

/// No deadline.
pub(crate) const NEVER: Nanos = Nanos::MAX;

/// One task.
#[derive(Debug)]
pub(crate) struct TaskSlot {
    pub(crate) id: i32,
    pub(crate) stack_bytes: usize,
    pub(crate) state: Guarded<TaskState>,
    /// The one made before.
    next: Option<&'static TaskSlot>,
}

/// The changing part of a slot.
pub(crate) struct TaskState {
    pub(crate) task: Option<Task>,
    /// The priority set last, without inheritance.
    pub(crate) priority: u8,
    /// The priority that the kernel got last.
    pub(crate) effective: u8,
    /// Time at which the task wants to be woken at the latest.
    pub(crate) deadline: Nanos,
    /// The word the task waits on; null: none.
    pub(crate) waits_on: *const AtomicU32,
    /// The word is a lock's, and this task lends its owner its priority.
    pub(crate) lends: bool,
    pub(crate) ended: bool,
    pub(crate) blocked: BlockedIntervals,
    /// The reading of the CPU clock that [`limited_by`](Self::limited_by) waits for.
    pub(super) limit: Nanos,
    /// The task to wake at the limit.
    pub(super) limited_by: Option<&'static TaskSlot>,
    /// A task that this one supervises has reached its limit.
    pub(super) reached: bool,
    cpu: Nanos,
    in_at: Nanos,
    pub(super) on_cpu: bool,
    pub(super) blocks: u32,
    pub(super) preemptions: u32,
}

// SAFETY: the pointer leads to a word that the waiting task borrows; it is followed masked.
unsafe impl Send for TaskState {}

impl TaskState {
    /// CPU time up to `now`.
    #[inline(never)]
    pub(crate) fn cpu(&self, now: Nanos) -> Nanos {
        if self.on_cpu {
            self.cpu + since(now, self.in_at)
        } else {
            self.cpu
        }
    }

    /// Time at which the task reaches its limit if it runs on from `now`.
    pub(super) fn reaches_limit_at(&self, now: Nanos) -> Nanos {
        later(now, since(self.limit, self.cpu(now)))
    }

    /// The task loses the CPU: `preempted`, or because it blocks.
    pub(super) fn switched_out(&mut self, now: Nanos, preempted: bool) {
        self.cpu += now.wrapping_sub(self.in_at); // the clock never goes back
        self.on_cpu = false;
        if preempted {
            self.preemptions = self.preemptions.wrapping_add(1);
        } else {
            self.blocks = self.blocks.wrapping_add(1);
            self.blocked.open(now);
        }
    }

    /// The task gets the CPU. Returns when it reaches its limit, [`NEVER`] without one.
    pub(super) fn switched_in(&mut self, now: Nanos) -> Nanos {
        self.in_at = now;
        self.on_cpu = true;
        let cpu = self.cpu;
        self.blocked.close(now, cpu);
        if self.limit == NEVER {
            NEVER
        } else {
            self.reaches_limit_at(now)
        }
    }

    /// Forgets that a supervised task has reached its limit. Returns whether one had.
    pub(crate) fn take_reached(&mut self) -> bool {
        core::mem::take(&mut self.reached)
    }
}

static SLOTS: AtomicPtr<TaskSlot> = AtomicPtr::new(ptr::null_mut());
/// The running task's: what the hook was given last.
static CURRENT: AtomicPtr<TaskSlot> = AtomicPtr::new(ptr::null_mut());

/// A new slot, to be given to a task.
pub(crate) fn make(priority: u8, stack_bytes: usize) -> &'static TaskSlot {
    let slot = Box::leak(Box::new(TaskSlot {
        id: 1,
        stack_bytes,
        state: Guarded::new(TaskState {
            task: None,
            priority,
            effective: priority,
            deadline: NEVER,
            waits_on: ptr::null(),
            lends: false,
            ended: false,
            blocked: BlockedIntervals::new(),
            limit: NEVER,
            limited_by: None,
            reached: false,
            cpu: 0,
            in_at: 0,
            on_cpu: false,
            blocks: 0,
            preemptions: 0,
        }),
        next: None,
    }));
    let _section = CriticalSection::enter();
    if let Some(newest) = all().next() {
        slot.id = newest.id + 1;
        slot.next = Some(newest);
    }
    SLOTS.store(ptr::from_mut(slot), Ordering::Release);
    slot
}

/// All slots, newest first.
pub(crate) fn all() -> impl Iterator<Item = &'static TaskSlot> {
    // SAFETY: slots are leaked boxes, published whole.
    let newest = unsafe { SLOTS.load(Ordering::Acquire).as_ref() };
    core::iter::successors(newest, |slot| slot.next)
}

/// The running task's; `None` before the kernel runs and in the idle task.
#[inline]
pub(crate) fn current() -> Option<&'static TaskSlot> {
    // SAFETY: the kernel keeps what `rp_task_create` was given: a leaked box, or null.
    unsafe { CURRENT.load(Ordering::Relaxed).as_ref() }
}

/// The running task is the one with this slot, null for the idle task: the hook's alone.
pub(super) fn set_current(slot: *const TaskSlot) {
    CURRENT.store(slot.cast_mut(), Ordering::Relaxed);
}

/// The slot with this number: mostly one's own.
pub(crate) fn find(id: i32) -> Option<&'static TaskSlot> {
    current()
        .filter(|slot| slot.id == id)
        .or_else(|| all().find(|slot| slot.id == id))
}

/// Whether the switch hooks are there: always, the kernel is compiled with them.
pub(crate) const fn sees_switches() -> bool {
    true
}

/// The task's function has returned.
pub(crate) fn end(slot: &TaskSlot) {
    slot.state.with(|s| s.ended = true);
}

/// Number of times that the calling task has blocked so far.
#[must_use]
pub fn voluntary_switches() -> u64 {
    current().map_or(0, |slot| slot.state.with(|s| s.blocks.into()))
}

//! The state of each thread in this back end.
//!
//! ```text
//!   free ── make ──► a thread's ── switch hooks keep its CPU time ──► its end ──► free
//! ```
//!
//! Slots are made at set-up, linked into one list, used again after their thread has ended, and
//! never freed: as many as there ever were threads at the same time. A thread that this crate did
//! not make gets one when it first waits, locks or is asked for its number. Time in interrupts
//! counts for the thread they interrupt.
#![expect(
    unsafe_code,
    reason = "hooks get slots as pointers; the list's end is one"
)]

use super::ffi::{self, ThreadMemory};
use super::report;
use crate::Nanos;
use crate::rtos::blocked_intervals::BlockedIntervals;
use crate::rtos::critical_section::{CriticalSection, Guarded};
use alloc::boxed::Box;
use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};

/// No deadline.
pub(crate) const NEVER: Nanos = Nanos::MAX;

/// A thread that can be woken, raised and lowered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Task(pub(super) &'static TaskSlot);

/// One thread.
#[derive(Debug)]
pub(crate) struct TaskSlot {
    pub(crate) id: i32,
    pub(crate) thread: ThreadMemory,
    pub(crate) state: Guarded<TaskState>,
    next: AtomicPtr<TaskSlot>,
}

/// The changing part of a slot.
pub(crate) struct TaskState {
    /// `None` before the thread runs and after it has ended.
    pub(crate) task: Option<Task>,
    pub(crate) stack_bytes: usize,
    /// The priority set last, without inheritance.
    pub(crate) priority: u8,
    /// The priority that the system got last.
    pub(crate) effective: u8,
    /// Time at which the thread wants to be woken at the latest.
    pub(crate) deadline: Nanos,
    /// The deadline it sleeps with; 0 while it does not sleep.
    pub(crate) parked_until: Nanos,
    /// The word the thread waits on; null: none.
    pub(crate) waits_on: *const AtomicU32,
    /// The word is a lock's, and this thread lends its owner its priority.
    pub(crate) lends: bool,
    pub(crate) ended: bool,
    pub(crate) blocked: BlockedIntervals,
    /// Number of the thread among those that had this slot.
    pub(crate) generation: u32,
    free: bool,
    cpu: Nanos,
    in_at: Nanos,
    on_cpu: bool,
    blocks: u32,
}

// SAFETY: the pointer leads to a word that the waiting thread borrows; it is followed masked.
unsafe impl Send for TaskState {}

impl TaskState {
    fn new(stack_bytes: usize, priority: u8) -> Self {
        Self {
            task: None,
            stack_bytes,
            priority,
            effective: priority,
            deadline: NEVER,
            parked_until: 0,
            waits_on: ptr::null(),
            lends: false,
            ended: false,
            blocked: BlockedIntervals::new(),
            generation: 0,
            free: false,
            cpu: 0,
            in_at: 0,
            on_cpu: false,
            blocks: 0,
        }
    }

    /// CPU time up to `now`.
    pub(crate) fn cpu(&self, now: Nanos) -> Nanos {
        match self.task {
            Some(Task(slot)) if !sees_switches() => slot.thread.cpu_time(),
            _ if self.on_cpu => self.cpu + now.saturating_sub(self.in_at),
            _ => self.cpu,
        }
    }

    /// Whether the task has reached its limit: never, see [`limit`].
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn take_reached(&mut self) -> bool {
        false
    }

    /// The thread loses the CPU: `preempted`, or because it blocks.
    pub(super) fn switched_out(&mut self, now: Nanos, preempted: bool) {
        self.cpu += now.saturating_sub(self.in_at);
        self.on_cpu = false;
        if !preempted {
            self.blocks = self.blocks.wrapping_add(1);
            self.blocked.open(now);
        }
    }

    /// The thread gets the CPU.
    pub(super) fn switched_in(&mut self, now: Nanos) {
        self.in_at = now;
        self.on_cpu = true;
        let cpu = self.cpu;
        self.blocked.close(now, cpu);
    }
}

static SLOTS: AtomicPtr<TaskSlot> = AtomicPtr::new(ptr::null_mut());
static COUNT: AtomicU32 = AtomicU32::new(0);

/// Whether CPU time and blocking come from the switch hooks.
pub(crate) const fn sees_switches() -> bool {
    !cfg!(nuttx_host)
}

/// A slot for a new thread; `None` where nothing can run.
pub(crate) fn make(priority: u8, stack_bytes: usize) -> Option<&'static TaskSlot> {
    if !report::is_good() {
        return None;
    }
    let fresh = || TaskState::new(stack_bytes, priority);
    let used = all().find(|slot| {
        slot.state.with(|s| {
            let free = s.free;
            if free {
                let generation = s.generation.wrapping_add(1);
                *s = TaskState {
                    generation,
                    ..fresh()
                };
            }
            free
        })
    });
    if used.is_some() {
        return used;
    }
    let id = COUNT.fetch_add(1, Ordering::Relaxed) + 1;
    let slot = Box::leak(Box::new(TaskSlot {
        id: i32::try_from(id).unwrap_or(i32::MAX),
        thread: ThreadMemory::new(),
        state: Guarded::new(fresh()),
        next: AtomicPtr::new(ptr::null_mut()),
    }));
    slot.thread.init().ok()?;
    let _section = CriticalSection::enter();
    slot.next
        .store(SLOTS.load(Ordering::Acquire), Ordering::Release);
    SLOTS.store(ptr::from_mut(slot), Ordering::Release);
    Some(slot)
}

/// All slots, newest first.
pub(crate) fn all() -> impl Iterator<Item = &'static TaskSlot> {
    let mut at = SLOTS.load(Ordering::Acquire);
    core::iter::from_fn(move || {
        // SAFETY: slots are leaked boxes, published whole.
        let slot = unsafe { at.as_ref() }?;
        at = slot.next.load(Ordering::Acquire);
        Some(slot)
    })
}

/// The calling thread's; `None` where nothing can run.
pub(crate) fn current() -> Option<&'static TaskSlot> {
    // SAFETY: the shim keeps what `adopt` was given: a leaked box, or null.
    unsafe { ffi::current().cast::<TaskSlot>().as_ref() }.or_else(attach)
}

/// A slot for a calling thread that this crate did not make.
#[cold]
fn attach() -> Option<&'static TaskSlot> {
    let slot = make(1, 0)?;
    if !begin(slot) {
        discard(slot);
        return None;
    }
    let priority = slot.thread.policy().map_or(1, |how| how.priority);
    let priority = u8::try_from(priority).unwrap_or(u8::MAX);
    slot.state
        .with(|s| (s.priority, s.effective) = (priority, priority));
    Some(slot)
}

/// The calling thread is the slot's from now on.
pub(crate) fn begin(slot: &'static TaskSlot) -> bool {
    let adopted = ffi::adopt(&slot.thread, ptr::from_ref(slot).cast()).is_ok();
    if adopted {
        let now = ffi::board_now();
        slot.state.with(|s| {
            s.task = Some(Task(slot));
            s.switched_in(now);
        });
    }
    adopted
}

/// The slot was made for a thread that never came to be.
pub(crate) fn discard(slot: &TaskSlot) {
    slot.state.with(|s| (s.ended, s.free) = (true, true));
}

/// The thread's function has returned; what it has to say was said.
pub(crate) fn end(slot: &TaskSlot) {
    slot.state.with(|s| s.ended = true);
}

/// The calling thread gives its slot back; it does nothing with this crate any more.
pub(crate) fn release(slot: &'static TaskSlot) {
    ffi::forget();
    slot.state.with(|s| {
        s.ended = true;
        s.task = None;
        s.on_cpu = false;
        s.free = true;
    });
}

/// The slot with this number.
pub(crate) fn find(id: i32) -> Option<&'static TaskSlot> {
    all().find(|slot| slot.id == id)
}

/// Number of times that the calling thread has blocked so far.
#[must_use]
pub fn voluntary_switches() -> u64 {
    if sees_switches() {
        current().map_or(0, |slot| slot.state.with(|s| s.blocks.into()))
    } else {
        ffi::blocks()
    }
}

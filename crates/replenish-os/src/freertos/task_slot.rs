//! What this back end knows of each task, kept up to date by the kernel's switch hooks.
//!
//! ```text
//!   loses the CPU, in its ready list ──► preempted: cpu += now - in_at
//!   loses the CPU, not in it         ──► blocked:   cpu += now - in_at, a gap opens
//!   gets the CPU, at the same now    ──► in_at = now, an open gap is complete
//! ```
//!
//! Slots are made at set-up, linked into one list and never freed. Time in interrupts counts for
//! the task they interrupt.
#![expect(
    unsafe_code,
    reason = "hooks get slots as pointers; the list's end is one"
)]

use super::alarm;
use super::blocked_intervals::Gaps;
use super::critical_section::{Mask, Masked, Quiet};
use super::ffi::{self, Task};
use crate::Nanos;
use alloc::boxed::Box;
use core::ffi::c_void;
use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};

/// No deadline.
pub(crate) const NEVER: Nanos = Nanos::MAX;

/// One task.
#[derive(Debug)]
pub(crate) struct Slot {
    pub(crate) id: i32,
    pub(crate) stack_bytes: usize,
    pub(crate) state: Masked<State>,
    /// The one made before.
    next: Option<&'static Slot>,
}

/// The changing part of a slot.
pub(crate) struct State {
    pub(crate) task: Option<Task>,
    /// The priority set last, without inheritance.
    pub(crate) priority: u8,
    /// The priority the kernel was told last.
    pub(crate) effective: u8,
    /// When the task wants to be woken at the latest.
    pub(crate) deadline: Nanos,
    /// The word the task waits on; null: none.
    pub(crate) waits_on: *const AtomicU32,
    /// The word is a lock's, and this task lends its owner its priority.
    pub(crate) lends: bool,
    pub(crate) ended: bool,
    pub(crate) gaps: Gaps,
    /// The reading of its CPU clock that is waited for; `NEVER`: none is.
    limit: Nanos,
    /// Who waits for it.
    limited_by: Option<&'static Slot>,
    /// What this task has limited has come: a task that it supervises is at its limit.
    reached: bool,
    cpu: Nanos,
    in_at: Nanos,
    on_cpu: bool,
    pub(super) blocks: u32,
    pub(super) preemptions: u32,
}

// SAFETY: the pointer leads to a word that the waiting task borrows; it is followed masked.
unsafe impl Send for State {}

impl State {
    /// CPU time up to `now`.
    #[inline(never)]
    pub(crate) fn cpu(&self, now: Nanos) -> Nanos {
        if self.on_cpu {
            self.cpu + now.saturating_sub(self.in_at)
        } else {
            self.cpu
        }
    }

    /// When it is at its limit if it goes on running from `now` on.
    fn at_limit(&self, now: Nanos) -> Nanos {
        now.saturating_add(self.limit.saturating_sub(self.cpu(now)))
    }

    /// Takes back that a supervised task is at its limit; whether one was.
    pub(crate) fn take_reached(&mut self) -> bool {
        core::mem::take(&mut self.reached)
    }
}

/// The CPU clocks of tasks ring as timers do: when the one that runs has a limit, the board's timer is set
/// for the time at which it will be there, unless it is set for something before. A task that does not
/// run needs no looking after.
///
/// `by` is woken from its timer's `read`. Whether that works: it has to have read before.
pub(crate) fn limit(of: &'static Slot, by: Option<&'static Slot>, at: Nanos) -> bool {
    let Some(by) = by else { return false };
    let mask = Mask::set();
    let quiet = mask.quiet();
    let rings = of.state.within(quiet, |s| {
        s.limit = at;
        s.limited_by = Some(by);
        match at != NEVER && s.on_cpu {
            true => s.at_limit(ffi::board_now()),
            false => NEVER,
        }
    });
    if rings != NEVER || current().is_some_and(|me| ptr::eq(me, of)) {
        LIMIT_AT.within(quiet, |at| *at = rings);
        alarm::program(rings, quiet);
    }
    true
}

/// Whether the task is where `limit` wanted it, within `slack`; `None` if it has no limit.
pub(crate) fn is_at_limit(of: &Slot, now: Nanos, slack: Nanos) -> Option<bool> {
    of.state.with(|s| {
        let at = s.limit.saturating_sub(slack);
        (s.limit != NEVER).then(|| s.cpu(now) >= at)
    })
}

/// When the running task reaches its limit.
pub(crate) fn limit_at(quiet: Quiet<'_>) -> Nanos {
    LIMIT_AT.within(quiet, |at| *at)
}

/// The running task is at its limit, which it has no more. Who is to be woken for that.
pub(crate) fn reach_limit(quiet: Quiet<'_>) -> Option<Task> {
    LIMIT_AT.within(quiet, |at| *at = NEVER);
    let by = current()?.state.within(quiet, |s| s.limited_by)?;
    by.state.within(quiet, |s| {
        s.reached = true;
        s.task
    })
}

/// When the running task will be at its limit.
static LIMIT_AT: Masked<Nanos> = Masked::new(NEVER);
static SLOTS: AtomicPtr<Slot> = AtomicPtr::new(ptr::null_mut());
/// The running task's: what the hook was given last.
static CURRENT: AtomicPtr<Slot> = AtomicPtr::new(ptr::null_mut());

/// A new slot, to be given to a task.
pub(crate) fn make(priority: u8, stack_bytes: usize) -> &'static Slot {
    let slot = Box::leak(Box::new(Slot {
        id: 1,
        stack_bytes,
        state: Masked::new(State {
            task: None,
            priority,
            effective: priority,
            deadline: NEVER,
            waits_on: ptr::null(),
            lends: false,
            ended: false,
            gaps: Gaps::new(),
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
    let _mask = Mask::set();
    if let Some(newest) = all().next() {
        slot.id = newest.id + 1;
        slot.next = Some(newest);
    }
    SLOTS.store(ptr::from_mut(slot), Ordering::Release);
    slot
}

/// All slots, newest first.
pub(crate) fn all() -> impl Iterator<Item = &'static Slot> {
    // SAFETY: slots are leaked boxes, published whole.
    let newest = unsafe { SLOTS.load(Ordering::Acquire).as_ref() };
    core::iter::successors(newest, |slot| slot.next)
}

/// The running task's; `None` before the kernel runs and in the idle task.
#[inline]
pub(crate) fn current() -> Option<&'static Slot> {
    // SAFETY: the kernel keeps what `rp_task_create` was given: a leaked box, or null.
    unsafe { CURRENT.load(Ordering::Relaxed).as_ref() }
}

/// The slot with this number: mostly one's own.
pub(crate) fn find(id: i32) -> Option<&'static Slot> {
    current()
        .filter(|slot| slot.id == id)
        .or_else(|| all().find(|slot| slot.id == id))
}

/// Whether the switch hooks are there: always, the kernel is compiled with them.
pub(crate) const fn sees_switches() -> bool {
    true
}

/// The task's function has returned.
pub(crate) fn end(slot: &Slot) {
    slot.state.with(|s| s.ended = true);
}

/// How often the calling task has blocked so far.
#[must_use]
pub fn voluntary_switches() -> u64 {
    current().map_or(0, |slot| slot.state.with(|s| s.blocks.into()))
}

/// The kernel's hook: `slot`'s task is about to run instead of the one that did, which was
/// `preempted` or has blocked.
#[unsafe(no_mangle)]
extern "C" fn rp_switched(slot: *const c_void, preempted: u32) {
    // SAFETY: the kernel switches masked.
    let quiet = unsafe { Quiet::by_caller() };
    let out = current();
    CURRENT.store(slot.cast_mut().cast(), Ordering::Relaxed);
    let now = ffi::board_now();
    if let Some(out) = out {
        out.state.within(quiet, |s| {
            s.cpu += now.wrapping_sub(s.in_at); // the clock never goes back
            s.on_cpu = false;
            if preempted == 0 {
                s.blocks = s.blocks.wrapping_add(1);
                s.gaps.open(now);
            } else {
                s.preemptions = s.preemptions.wrapping_add(1);
            }
        });
    }
    let limit = current().map_or(NEVER, |slot| {
        slot.state.within(quiet, |s| {
            s.in_at = now;
            s.on_cpu = true;
            let cpu = s.cpu;
            s.gaps.close(now, cpu);
            match s.limit {
                NEVER => NEVER,
                _ => s.at_limit(now),
            }
        })
    });
    LIMIT_AT.within(quiet, |at| *at = limit);
    alarm::program(limit, quiet);
}

//! The board's one timer: the deadlines of all tasks, and the limits of their CPU clocks.
//!
//! The timer is set when a deadline comes before what it is set to, and never to a later time: a
//! wait that ends before its deadline leaves it, and the interrupt then finds nothing due. One look
//! of an interrupt too many costs less than looking through all tasks with every wait.
//!
//! A limit on a CPU clock rings as a deadline does: when its task runs, the timer is set for the
//! time at which the clock will show the limit. A task that does not run cannot reach its limit.

use super::ffi::{self, Task};
use super::task_slot::{self, NEVER, TaskSlot};
use crate::Nanos;
use crate::rtos::critical_section::{CriticalSection, Guarded};
use crate::rtos::cs_token::CsToken;
use core::ptr;
use sporadic::since;

/// The time that the board's timer is set to.
static SET: Guarded<Nanos> = Guarded::new(NEVER);
/// Time at which the running task will be at its limit.
static LIMIT_AT: Guarded<Nanos> = Guarded::new(NEVER);

/// Before the kernel runs: the board counts its overflows when the timer rings, asked or not.
pub(crate) fn begin() {
    ffi::board_arm(NEVER, CriticalSection::enter().token());
}

/// A task's deadline is `at` now.
#[cfg_attr(feature = "outlined", inline(never))]
pub(crate) fn program(at: Nanos, cs: CsToken<'_>) {
    SET.within(cs, |set| {
        if at < *set {
            *set = at;
            ffi::board_arm(at, cs);
        }
    });
}

/// The running task will be at its limit at `at`; [`NEVER`]: it has none.
pub(super) fn program_limit(at: Nanos, cs: CsToken<'_>) {
    LIMIT_AT.within(cs, |limit| *limit = at);
    program(at, cs);
}

/// Wakes `by` from its timer's `read` when the CPU clock of `of` shows `at`; [`NEVER`]: no more.
///
/// Returns whether that works: `by` must have read its timer before.
pub(crate) fn limit(of: &'static TaskSlot, by: Option<&'static TaskSlot>, at: Nanos) -> bool {
    let Some(by) = by else { return false };
    let section = CriticalSection::enter();
    let cs = section.token();
    let rings = of.state.within(cs, |s| {
        s.limit = at;
        s.limited_by = Some(by);
        if at != NEVER && s.on_cpu {
            s.reaches_limit_at(ffi::board_now())
        } else {
            NEVER
        }
    });
    if rings != NEVER || task_slot::current().is_some_and(|me| ptr::eq(me, of)) {
        program_limit(rings, cs);
    }
    true
}

/// Whether the task is at its limit, or within `slack` of it; `None` if it has no limit.
pub(crate) fn is_at_limit(of: &TaskSlot, now: Nanos, slack: Nanos) -> Option<bool> {
    of.state.with(|s| {
        let at = since(s.limit, slack);
        (s.limit != NEVER).then(|| s.cpu(now) >= at)
    })
}

/// The running task has reached its limit, which is thereby gone. Returns the task to wake.
fn reach_limit(cs: CsToken<'_>) -> Option<Task> {
    LIMIT_AT.within(cs, |at| *at = NEVER);
    let by = task_slot::current()?.state.within(cs, |s| s.limited_by)?;
    by.state.within(cs, |s| {
        s.reached = true;
        s.task
    })
}

/// The board's timer interrupt: wakes every task whose deadline has come, in the order of their
/// deadlines, the oldest of equals first; sets the timer for the next.
pub(crate) fn on_timer() {
    loop {
        let now = ffi::board_now();
        let section = CriticalSection::enter();
        let cs = section.token();
        let limit = LIMIT_AT.within(cs, |at| *at);
        if limit <= now {
            let task = reach_limit(cs);
            drop(section);
            if let Some(task) = task {
                ffi::wake(task);
            }
            continue;
        }
        // Newest first: with <=, the oldest of equals wins; and one without a deadline never does.
        let (at, first) = task_slot::all().fold((NEVER - 1, None), |(earliest, first), slot| {
            let at = slot.state.within(cs, |s| s.deadline);
            if at <= earliest {
                (at, Some(slot))
            } else {
                (earliest, first)
            }
        });
        let due = first.filter(|_| at <= now);
        let Some(slot) = due else {
            let at = at.min(limit);
            SET.within(cs, |set| *set = at);
            ffi::board_arm(at, cs);
            return;
        };
        let task = slot.state.within(cs, |s| {
            s.deadline = NEVER;
            s.task
        });
        drop(section);
        if let Some(task) = task {
            ffi::wake(task);
        }
    }
}

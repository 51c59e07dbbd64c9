//! Deadlines: each thread sleeps with its own. One that moves closer ends the sleep, so that the
//! thread sleeps anew.

use super::task_slot::{self, TaskSlot};
use crate::Nanos;
use crate::rtos::cs_token::CsToken;

/// Some thread's deadline has changed.
pub(crate) fn program(_: Nanos, cs: CsToken<'_>) {
    for slot in task_slot::all() {
        let earlier = slot.state.within(cs, |s| {
            let earlier = s.deadline < s.parked_until;
            if earlier {
                s.parked_until = s.deadline;
            }
            earlier
        });
        if earlier {
            slot.thread.unpark();
        }
    }
}

/// Refuses a limit on a thread's CPU clock: this system has none, so enforcers look at times.
pub(crate) const fn limit(_: &TaskSlot, _: Option<&'static TaskSlot>, _: Nanos) -> bool {
    false
}

/// There are no limits: see [`limit`].
pub(crate) const fn is_at_limit(_: &TaskSlot, _: Nanos, _: Nanos) -> Option<bool> {
    None
}

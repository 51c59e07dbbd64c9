//! Deadlines: each thread sleeps with its own. One that moves closer ends the sleep, so that the
//! thread sleeps anew.

use super::critical_section::Quiet;
use super::task_slot;
use crate::Nanos;

/// Some thread's deadline has changed.
pub(crate) fn program(_: Nanos, quiet: Quiet<'_>) {
    for slot in task_slot::all() {
        let earlier = slot.state.within(quiet, |s| {
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

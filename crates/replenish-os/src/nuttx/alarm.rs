//! Deadlines: each thread sleeps with its own. One that moves closer ends the sleep, so that the
//! thread sleeps anew.

use super::masked::Quiet;
use super::slot;
use crate::Nanos;

/// Some thread's deadline has changed.
pub(crate) fn program(_: Nanos, quiet: Quiet<'_>) {
    for slot in slot::all() {
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

//! Deadlines: each thread sleeps with its own. One that moves closer ends the sleep, so that the
//! thread sleeps anew.

use super::slot;
use crate::Nanos;

/// Some thread's deadline has changed; masked.
pub(crate) fn program(_: Nanos) {
    for slot in slot::all() {
        let earlier = slot.state.with(|s| {
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

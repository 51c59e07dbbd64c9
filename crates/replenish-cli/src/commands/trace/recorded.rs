//! The events of a recording at one look.

use crate::live::Program;
use replenish_recorder::{Copied, Event};

/// The events of one thread.
pub(super) struct Recorded {
    pub(super) events: Vec<Event>,
    pub(super) budget: Vec<Event>,
    pub(super) copied: [Copied; 2],
}

/// Events of each thread of a program, by time.
pub(super) fn record(program: &Program) -> Vec<Recorded> {
    let threads = program.view.threads.iter();
    let record = threads.map(|thread| {
        let (mut events, first) = thread.events(&program.source);
        let (budget, second) = thread.budget_events(&program.source);
        // An arrival is older than the moment at which the dispatcher looked.
        events.sort_by_key(|event| event.time);
        Recorded {
            events,
            budget,
            copied: [first, second],
        }
    });
    record.collect()
}

//! The surroundings of a callback on its worker's thread.

use super::outbox::Outbox;
use crate::event::Events;
use crate::executor::wake::stop::StopHandle;
use crate::handoff::{Inbox, RingSlot};
use crate::middleware::Middleware;
use crate::stats::Counters;
use core::any::Any;
use core::cell::RefCell;
use replenish_os::{Meter, clock};

/// The surroundings of a callback.
pub(crate) struct Env<'a> {
    pub(crate) worker: &'a str,
    pub(crate) stop: &'a StopHandle,
    pub(crate) events: &'a Events,
    pub(crate) meter: &'a Meter,
    pub(crate) middleware: &'a dyn Middleware,
    /// The running executor, for changes of its handles. The room `change` knows its type.
    #[allow(
        dead_code,
        reason = "handles of builds without feature `full` never change"
    )]
    pub(crate) live: Option<&'a dyn Any>,
    /// Publications that wait for the end of the round.
    pub(crate) outbox: Option<&'a RefCell<Outbox>>,
}

impl Env<'_> {
    /// The next sample that waits, for the one in `read_slot`; none if its lifespan is over.
    pub(crate) fn next_sample<'h>(
        &self,
        inbox: &Inbox,
        read_slot: &'h mut Option<RingSlot>,
        counters: &Counters,
    ) -> Option<&'h RingSlot> {
        if inbox.pop(read_slot)? {
            self.middleware.wake();
        }
        let slot = read_slot.as_mut()?;
        let expires = slot.info().expires;
        if let Some(expires) = expires
            && expires <= clock::monotonic()
        {
            slot.take_shared();
            counters.discarded.add(1);
            return None;
        }
        Some(slot)
    }
}

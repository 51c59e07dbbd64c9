//! The surroundings of a callback on its worker's thread.

use super::outbox::Outbox;
use crate::event::Events;
use crate::executor::wake::stop::StopHandle;
use crate::handoff::{Inbox, RingSlot};
use core::any::Any;
use core::cell::RefCell;
use replenish_os::Meter;

/// The surroundings of a callback.
pub(crate) struct Env<'a> {
    pub(crate) worker: &'a str,
    pub(crate) stop: &'a StopHandle,
    pub(crate) events: &'a Events,
    pub(crate) meter: &'a Meter,
    /// The running executor, for changes of its handles. The room `change` knows its type.
    #[cfg_attr(not(feature = "full"), expect(dead_code, reason = "none can"))]
    pub(crate) live: Option<&'a dyn Any>,
    /// Publications that wait for the end of the round.
    pub(crate) outbox: Option<&'a RefCell<Outbox>>,
}

impl Env<'_> {
    /// The next sample that waits, for the one in `read_slot`.
    pub(crate) fn next_sample<'h>(
        &self,
        inbox: &Inbox,
        read_slot: &'h mut Option<RingSlot>,
    ) -> Option<&'h RingSlot> {
        if inbox.pop(read_slot)? {
            self.stop.middleware.wake();
        }
        read_slot.as_ref()
    }
}

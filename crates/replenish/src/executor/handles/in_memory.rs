//! A subscription's messages that publishers of this process bring themselves, as they are in
//! memory: past the dispatcher, without a copy.
//!
//! ```text
//!   publisher ── lock of the bus: inbox.share, mark ── unlock ── ring ──► worker
//! ```
//!
//! Either the publisher sees the way to the worker here, or the worker sees the message when it
//! begins: each writes its own first, and there is a fence between.

use super::state::HandleState;
use crate::executor::wake::doorbell::{Doorbell, WakeHandle};
use crate::handoff::{DeliveryOutcome, Keep, SampleInfo, Shared};
use crate::middleware::Middleware;
use crate::platform::{Deliver, LocalReader, recorder};
use crate::sync::{Arc, Ordering, fence};

impl Deliver<dyn Middleware> for HandleState {
    fn deliver(
        &self,
        message: &Shared,
        info: &SampleInfo,
    ) -> (DeliveryOutcome, Option<Arc<Doorbell>>) {
        let Some((_, inbox)) = &self.input else {
            return (DeliveryOutcome::Closed, None);
        };
        self.counters.received.count(1);
        recorder::take(self.name, info.arrival, 0);
        let outcome = inbox.share(message, info);
        match outcome {
            DeliveryOutcome::Stored => {}
            DeliveryOutcome::Closed => {
                self.counters.discarded.add(1);
            }
            DeliveryOutcome::ReplacedOldest
            | DeliveryOutcome::NoRoom
            | DeliveryOutcome::Oversize => {
                self.counters.dropped.add(1);
                recorder::dropped(self.name, info.arrival, 0);
            }
        }
        fence(Ordering::SeqCst);
        let bell = self.wake.get().map(|wake| {
            wake.mark();
            Arc::clone(wake.bell())
        });
        (outcome, bell)
    }
}

impl HandleState {
    /// Its worker begins.
    pub(super) fn begin(&self, wake: &WakeHandle) {
        self.wake.set(wake.clone()).ok();
        fence(Ordering::SeqCst);
    }
}

/// From now on the subscription takes messages of type `M` as they are in memory, too. One that
/// keeps all gets them from the dispatcher, which knows when it has no room.
pub(crate) fn take_in_memory<M: 'static>(shared: &Arc<HandleState>, middleware: &dyn Middleware) {
    if let Some((reader, inbox)) = &shared.input
        && inbox.keep() != Keep::All
        && let Some(local) = LocalReader::of::<M>(shared)
    {
        middleware.share_with(*reader, local);
    }
}

//! The interface between a worker and a handle, whatever its kind.

use super::deadline::Deadline;
use super::env::Env;
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::run_queue::RunQueue;
use crate::handoff::{Inbox, RingSlot};
use crate::middleware::encoding::decode;
use crate::platform::chain::Provenance;
use replenish_msg::{CdrReader, Message};

/// Input that waits for its callback.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Taken {
    /// The release: the sample's arrival, or the timer's release.
    pub(crate) due: Nanos,
    /// The callback's deadline after the release, if the handle's kind has one.
    pub(crate) deadline: Option<Deadline>,
    /// The origins and the stamps that its sample brought.
    pub(crate) provenance: Provenance,
}

impl Taken {
    pub(crate) fn sample(slot: &RingSlot) -> Self {
        let info = slot.info();
        Self {
            due: info.arrival,
            deadline: None,
            provenance: Provenance::of(&info),
        }
    }
}

/// One callback of a worker and what triggers it. Lives on the worker's thread.
///
/// ```text
///   is_ready? ──► take: one sample or release ──► execute: the callback, with what was taken
/// ```
pub(crate) trait Handle: Send {
    /// The executor starts now; `wake` leads to it.
    fn begin(&mut self, _start: Nanos, _wake: &WakeHandle) {}
    /// Whether there is something to take.
    fn is_ready(&mut self, now: &LazyNow) -> bool;
    /// Time at which it will have something to take by itself.
    fn next_release(&mut self) -> Option<Nanos> {
        None
    }
    /// Writes down its [next release](Self::next_release), if it has releases at all; it is at this
    /// position.
    fn note_release(&mut self, _position: usize, _agenda: &mut RunQueue) {}
    /// Takes one input, if there (still) is one and it can be used.
    fn take(&mut self, env: &Env<'_>) -> Option<Taken>;
    /// Runs the callback with what was taken last.
    fn execute(&mut self, env: &Env<'_>, started: Nanos);
    /// Whether somebody waits for what was taken last, and nothing comes in its place: a reply, or
    /// the wake-up of a future. It is not left out after a missed deadline.
    fn is_awaited(&self) -> bool {
        false
    }
    /// Whether the last input was unusable and the callback did not run.
    fn was_spoiled(&mut self) -> bool {
        false
    }
    /// Runs the callback without input, if it takes that.
    fn execute_empty(&mut self, _env: &Env<'_>, _started: Nanos) {}
}

impl HandleState {
    /// Takes the next sample of its inbox into `read_slot`, and decodes it in place unless it is in
    /// memory. One that cannot be decoded is reported and counted.
    pub(crate) fn take_sample<M: Message>(
        &self,
        inbox: &Inbox,
        read_slot: &mut Option<RingSlot>,
        message: &mut M,
        env: &Env<'_>,
    ) -> Option<Taken> {
        let slot = env.next_sample(inbox, read_slot, &self.counters)?;
        if slot.shared().is_some() {
            return Some(Taken::sample(slot)); // it is there as it is
        }
        match decode(message, &CdrReader::new(slot.payload())) {
            Ok(()) => Some(Taken::sample(slot)),
            Err(error) => {
                self.undecodable(error, env.events);
                None
            }
        }
    }
}

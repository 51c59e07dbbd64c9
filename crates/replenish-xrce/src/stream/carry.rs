//! Carries unacknowledged samples over to a new session with the receiver.
//!
//! The receiver has lost everything it had, also the fragments it had acknowledged: samples are
//! taken over whole or not at all. Only samples are: requests are made anew from their journal,
//! because their answers are lost, too.

use super::ring::{Part, Ring};
use crate::wire::StreamHeader;
use crate::wire::{SubmessageId, Submessages};

/// The result of a carry-over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Carried {
    /// Samples that will be sent again.
    pub samples: u64,
    /// Samples of which a part had been acknowledged and forgotten.
    pub lost: u64,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize> Ring<S, N> {
    /// Keeps the samples, as messages that were never sent.
    pub(super) fn carry_over(&mut self, header: StreamHeader) -> Carried {
        let mut carried = Carried::default();
        // Whether the fragments that follow belong to a sample that is kept.
        let mut keeping = false;
        let (mut kept, mut orphan) = (0_usize, false);
        for i in 0..self.used {
            let Some(slot) = self.get(i).copied().filter(|slot| !slot.spilled) else {
                continue;
            };
            let keep = match slot.part {
                Part::Whole => {
                    let samples = self.compact(i);
                    carried.samples = carried.samples.saturating_add(samples);
                    samples > 0
                }
                Part::First => {
                    keeping = self.fragment_id(i) == Some(SubmessageId::WriteData as u8);
                    carried.samples = carried.samples.saturating_add(u64::from(keeping));
                    keeping
                }
                Part::Middle | Part::Last => {
                    orphan |= !keeping && i == 0;
                    let keep = keeping;
                    keeping &= slot.part == Part::Middle;
                    keep
                }
            };
            if keep {
                self.shift(i, kept, slot.part);
                kept = kept.saturating_add(1);
            }
        }
        carried.lost = u64::from(orphan);
        self.restart(header, kept);
        if let Some(spill) = self.spill_mut() {
            if spill.id() == Some(SubmessageId::WriteData as u8) {
                spill.position = 0;
                carried.samples = carried.samples.saturating_add(1);
            } else {
                spill.clear();
            }
        }
        self.refill();
        carried
    }

    /// Removes from message `i` all but samples; returns their number.
    fn compact(&mut self, i: usize) -> u64 {
        let (start, end) = (
            self.header.session.header_len(),
            self.get(i).map_or(0, |slot| slot.len),
        );
        let mut samples = 0_u64;
        let mut at = start; // where the next submessage is
        let mut to = start; // where it goes
        while let Some((id, len)) = self.submessage_at(i, at, end) {
            let next = at.saturating_add(len);
            if id == SubmessageId::WriteData {
                samples = samples.saturating_add(1);
                if let Some(room) = self.room_of(i).filter(|_| to != at) {
                    room.copy_within(at..next.min(end), to);
                }
                to = to.saturating_add(next.min(end).saturating_sub(at));
            }
            at = next;
        }
        if let Some(slot) = self.get_mut(i) {
            slot.len = to;
        }
        samples
    }

    /// The submessage at `at` of message `i` and its length with header and padding.
    fn submessage_at(&self, i: usize, at: usize, end: usize) -> Option<(SubmessageId, usize)> {
        let bytes = self.bytes(i)?.get(at..end)?;
        let submessage = Submessages::new(bytes).next()?.ok()?;
        let len = submessage.payload.len().saturating_add(4);
        Some((submessage.id, len.next_multiple_of(4)))
    }

    /// The number of the submessage that the first fragment in message `i` begins.
    fn fragment_id(&self, i: usize) -> Option<u8> {
        let at = self.header.session.header_len().saturating_add(4);
        self.bytes(i)?.get(at).copied()
    }
}

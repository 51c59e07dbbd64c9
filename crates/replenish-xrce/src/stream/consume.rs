//! Delivering one message that is in order: its submessages, and those put together from fragments.
//!
//! A receiver that has no room stops the walk before the submessage that it refuses. The count of
//! submessages delivered so far is kept, so that the next walk of this message repeats none.

use super::reassembly::{Piece, Reassembly};
use crate::counter::count;
use crate::features::FRAGMENTS;
use crate::wire::{Fragment, Submessage, SubmessageId, Submessages};

/// The counters of a reliable input stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct InputStats {
    /// Messages handled, each once and in order.
    pub received: u64,
    /// Messages that had come before.
    pub duplicates: u64,
    /// Messages kept because an earlier one was missing.
    pub reordered: u64,
    /// Messages dropped because no slot was left for them, or they were longer than a slot.
    pub dropped: u64,
    /// Messages whose submessages were malformed (from there on ignored).
    pub malformed: u64,
    /// Submessages dropped because their fragments together were too long.
    pub too_long: u64,
}

impl InputStats {
    /// Both together.
    #[must_use]
    pub const fn plus(self, other: Self) -> Self {
        InputStats {
            received: self.received.saturating_add(other.received),
            duplicates: self.duplicates.saturating_add(other.duplicates),
            reordered: self.reordered.saturating_add(other.reordered),
            dropped: self.dropped.saturating_add(other.dropped),
            malformed: self.malformed.saturating_add(other.malformed),
            too_long: self.too_long.saturating_add(other.too_long),
        }
    }
}

/// Walks one message that is in order; false if a submessage was not taken. The first `taken`
/// submessages were delivered when this message came before, and are skipped.
pub(super) fn consume<R: AsRef<[u8]> + AsMut<[u8]>, const MAY_STOP: bool>(
    body: &[u8],
    reassembly: &mut Reassembly<R>,
    stats: &mut InputStats,
    taken: &mut u16,
    deliver: &mut impl FnMut(&Submessage<'_>) -> bool,
) -> bool {
    let mut malformed = false;
    let mut submessages = Submessages::new(body);
    let mut at = 0_u16;
    loop {
        let head = submessages.peek();
        let next = submessages.whole();
        if MAY_STOP && next.is_some() {
            at = at.saturating_add(1);
            if at <= *taken {
                continue;
            }
        }
        let goes_on = match next {
            Some(Submessage {
                id: SubmessageId::Fragment,
                ..
            }) if !FRAGMENTS => {
                count(&mut stats.too_long);
                true
            }
            Some(Submessage {
                id: SubmessageId::Fragment,
                flags,
                payload,
            }) => {
                let before = reassembly.collected();
                let goes_on = match reassembly.append(payload, flags & Fragment::FLAG_LAST != 0) {
                    Piece::Partial => true,
                    Piece::TooLong(beginning) => {
                        count(&mut stats.too_long);
                        // One piece may be longer than the room.
                        let payload = if before > 0 { beginning } else { payload };
                        let id = SubmessageId::Fragment;
                        deliver(&Submessage { id, flags, payload });
                        true
                    }
                    Piece::Complete(whole) => match deliver_whole(whole, deliver) {
                        Whole::Taken => true,
                        Whole::Malformed => {
                            malformed = true;
                            true
                        }
                        Whole::Refused => false,
                    },
                };
                if MAY_STOP && !goes_on {
                    reassembly.again(before);
                }
                goes_on
            }
            Some(submessage) => deliver(&submessage),
            None if submessages.is_done() => break,
            None => {
                malformed = true;
                if let Some((SubmessageId::Fragment, flags)) = head.filter(|_| FRAGMENTS) {
                    reassembly.spoil(flags & Fragment::FLAG_LAST != 0);
                }
                break;
            }
        };
        if MAY_STOP && !goes_on {
            *taken = at.saturating_sub(1);
            return false;
        }
    }
    count(&mut stats.received);
    if MAY_STOP {
        *taken = 0;
    }
    if malformed {
        count(&mut stats.malformed);
    }
    true
}

/// The fate of a submessage that was put together.
enum Whole {
    Taken,
    Malformed,
    Refused,
}

/// Delivers what fragments gave. Fragments of fragments are malformed. Only the first submessage
/// may be refused; no sender packs more into fragments.
fn deliver_whole(whole: &[u8], deliver: &mut impl FnMut(&Submessage<'_>) -> bool) -> Whole {
    if let Some(sample) = Submessage::unbounded(whole) {
        return if deliver(&sample) {
            Whole::Taken
        } else {
            Whole::Refused
        };
    }
    let mut first = true;
    for submessage in Submessages::new(whole) {
        match submessage {
            Ok(submessage) if submessage.id != SubmessageId::Fragment => {
                if !deliver(&submessage) && first {
                    return Whole::Refused;
                }
            }
            _ => return Whole::Malformed,
        }
        first = false;
    }
    Whole::Taken
}

//! [`PeerWriter`]: what a reader knows of one writer: which numbers have arrived.

use super::asked::Asked;
use super::offer::Offer;
use crate::promise::Lease;
use crate::wire::{Guid, LivelinessKind, Nanos, Qos, SequenceNumber};
use core::net::SocketAddr;

/// Numbers that may have arrived before an earlier one.
pub(crate) const WINDOW: i64 = 256;

/// The vendor id with which prefixes of Cyclone DDS begin. A latched writer of it tells readers of
/// its own alone what is from before the match; those of others get it if they ask.
pub(super) const CYCLONE: [u8; 2] = [0x01, 0x10];

/// One matched writer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PeerWriter {
    pub(crate) guid: Guid,
    pub(crate) to: SocketAddr,
    pub(crate) reliable: bool,
    /// The writer sends samples from before the match.
    pub(crate) late: bool,
    /// It sends samples from before the match to whoever asks, also if they are not late.
    pub(crate) reveals: bool,
    /// The first number that counts as lost if it does not come. `None`: nothing was heard yet.
    pub(crate) promised: Option<SequenceNumber>,
    /// All below have arrived or will not come.
    pub(crate) next: SequenceNumber,
    /// `next` when it was matched again, until a heartbeat; otherwise 0.
    had: SequenceNumber,
    /// Bit i: `next + i` has arrived or will not come. Bit 0 is never set between calls.
    seen: [u64; 4],
    /// The last number that the writer has announced.
    pub(crate) last: SequenceNumber,
    /// Of a best-effort writer: the last sample that had to give way. It will not be whole.
    pub(crate) refused: SequenceNumber,
    pub(crate) heartbeat_count: Option<u32>,
    /// An ACKNACK is to be sent.
    pub(crate) ack: bool,
    /// The latest time for it; 0: at once, and by itself. If it asks for a sample: the only time.
    pub(crate) ack_at: Nanos,
    pub(super) asked: Asked,
    /// The writer was not heard yet: the ACKNACK asks for a heartbeat.
    pub(crate) unheard: bool,
    /// The writer is alive as long as its participant is.
    pub(crate) automatic: bool,
    pub(crate) lease: Lease,
    /// Time in ns for which its samples are of use.
    pub(crate) lifespan: Nanos,
    /// The memory that it shares.
    pub(crate) offer: Option<Offer>,
}

impl PeerWriter {
    pub(crate) const fn new(
        guid: Guid,
        to: SocketAddr,
        (reliable, late): (bool, bool),
        qos: &Qos,
    ) -> Self {
        PeerWriter {
            guid,
            to,
            reliable,
            late,
            reveals: false,
            promised: None,
            next: 1,
            had: 0,
            seen: [0; 4],
            last: 0,
            refused: 0,
            heartbeat_count: None,
            ack: reliable,
            ack_at: 0,
            asked: Asked::NOTHING,
            unheard: true,
            automatic: matches!(qos.liveliness, LivelinessKind::Automatic),
            lease: Lease::new(qos.liveliness_lease),
            lifespan: qos.lifespan,
            offer: None,
        }
    }

    /// The same writer is matched again. It may never have lost this reader: then it repeats what
    /// was taken already.
    pub(crate) const fn continues(&mut self, before: &PeerWriter) {
        (self.next, self.had) = (before.next, before.next);
    }

    /// Whether what it is asked for has a time before which it is not asked.
    pub(super) const fn waits_to_ask(&self) -> bool {
        self.unheard || self.lacks()
    }

    /// Samples that it has announced are missing.
    pub(super) const fn lacks(&self) -> bool {
        self.next <= self.last
    }

    /// A sample has come. A writer that does not send earlier samples has promised none before it.
    pub(crate) fn heard_sample(&mut self, sn: SequenceNumber) {
        self.unheard = false;
        self.last = self.last.max(sn);
        if !self.late && self.promised.is_none() {
            self.promised = Some(sn);
        }
    }

    /// A heartbeat has come; returns the first number that counts as lost.
    ///
    /// Whether the writer wrote a sample before the match or after it, a first heartbeat does not
    /// say: such a sample is asked for, and does not count.
    pub(crate) fn heard_heartbeat(
        &mut self,
        first: SequenceNumber,
        last: SequenceNumber,
    ) -> SequenceNumber {
        self.unheard = false;
        self.last = self.last.max(last);
        let begin = if self.late {
            first
        } else {
            last.saturating_add(1)
        };
        *self.promised.get_or_insert(begin)
    }

    /// A heartbeat says how many samples there are, not how many there were at the match. A writer
    /// that has fewer than were taken before is another one that got the name of this one.
    pub(crate) const fn compare(&mut self, last: SequenceNumber) {
        if last.saturating_add(1) < self.had {
            (self.next, self.seen) = (1, [0; 4]);
        }
        self.had = 0;
    }

    fn at(&self, sn: SequenceNumber) -> Option<(usize, u64)> {
        let at = sn.checked_sub(self.next)?;
        if !(0..WINDOW).contains(&at) {
            return None;
        }
        let at = usize::try_from(at).ok()?;
        Some((at / 64, 1 << (at % 64)))
    }

    /// Whether the number can be taken now: it is not behind the window.
    pub(crate) const fn in_window(&self, sn: SequenceNumber) -> bool {
        sn.saturating_sub(self.next) < WINDOW
    }

    /// Whether the number has arrived or will not come.
    pub(crate) fn has(&self, sn: SequenceNumber) -> bool {
        let word = |(word, bit): (usize, u64)| self.seen.get(word).is_some_and(|w| w & bit != 0);
        sn < self.next || self.at(sn).is_some_and(word)
    }

    /// Marks a number.
    pub(crate) fn mark(&mut self, sn: SequenceNumber) {
        if let Some((word, bit)) = self.at(sn)
            && let Some(word) = self.seen.get_mut(word)
        {
            *word |= bit;
        }
    }

    /// A number that had arrived was thrown away and is wanted again.
    pub(crate) fn unmark(&mut self, sn: SequenceNumber) {
        if let Some((word, bit)) = self.at(sn)
            && let Some(word) = self.seen.get_mut(word)
        {
            *word &= !bit;
        }
    }

    /// Moves the window up to `to`; returns how many numbers below it had not been seen.
    pub(crate) fn advance(&mut self, to: SequenceNumber) -> u64 {
        let mut missed = 0;
        while self.next < to {
            if self.seen == [0; 4] {
                missed = to
                    .saturating_sub(self.next)
                    .unsigned_abs()
                    .saturating_add(missed);
                self.next = to;
                break;
            }
            missed += u64::from(!self.shift());
        }
        missed
    }

    /// Steps over the numbers at the window's start that have arrived.
    pub(crate) fn settle(&mut self) {
        while self.has(self.next) {
            self.shift();
        }
    }

    /// Moves on by one; whether that number had arrived.
    fn shift(&mut self) -> bool {
        let mut carry = 0;
        for word in self.seen.iter_mut().rev() {
            let out = *word & 1;
            *word = (*word >> 1) | (carry << 63);
            carry = out;
        }
        self.next = self.next.saturating_add(1);
        carry == 1
    }
}

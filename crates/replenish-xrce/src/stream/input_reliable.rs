//! Receiving on a reliable stream: reordering and acknowledging.
//!
//! ```text
//!        next                announced
//!         │                      │           numbers are mod 2^16
//!   ──────┼──────┬──────┬──────┬─┴────┬────
//!    done │ miss │ kept │ miss │ kept │      kept: waits in a slot for the missing ones
//!   ──────┴──────┴──────┴──────┴──────┴────
//! ```

use super::consume::{InputStats, consume};
use super::reassembly::Reassembly;
use crate::SeqNum;
use crate::counter::count;
use crate::time::{NEVER, Nanos, later};
use crate::wire::{AckNack, StreamId, Submessage};

/// Messages that can wait for a missing one at most. An acknowledgement names sixteen.
const MOST: usize = 31;

/// Acknowledgement policy of an input stream. A gap, a duplicate and a heartbeat are always
/// answered at once: only the confirmation that all is well can wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AckPolicy {
    /// After this many messages at the latest, 0 is as 1. At most a half of the sender's window,
    /// lest it stops.
    pub every: u16,
    /// After this many nanoseconds at the latest.
    pub delay: Nanos,
}

impl AckPolicy {
    /// Each message is acknowledged at the next opportunity.
    pub const IMMEDIATE: AckPolicy = AckPolicy { every: 1, delay: 0 };
    /// One acknowledgement for eight messages or 5 ms, for slow links.
    pub const BATCHED: AckPolicy = AckPolicy {
        every: 8,
        delay: 5_000_000,
    };
}

impl Default for AckPolicy {
    /// [`AckPolicy::IMMEDIATE`].
    fn default() -> Self {
        Self::IMMEDIATE
    }
}

/// The receiving end of a reliable stream: up to `N` messages wait in `S` for missing ones, and
/// fragments are collected in `R`.
#[derive(Debug)]
pub struct InputReliable<S, R, const N: usize> {
    slots: S,
    slot_size: usize,
    /// Slots in use, at most `N`.
    pub(super) capacity: usize,
    /// Length of the message in each slot.
    lens: [u16; N],
    /// Bit `i` set: message `next + i` waits in its slot; bit 0: it was not taken.
    pub(super) kept: u32,
    /// Slot for the message after `next`.
    head: usize,
    next: SeqNum,
    announced: SeqNum,
    reassembly: Reassembly<R>,
    stream: StreamId,
    ack_due: bool,
    policy: AckPolicy,
    /// Messages since the last acknowledgement.
    unconfirmed: u16,
    /// The acknowledgement must not wait.
    urgent: bool,
    /// Time at which it is due, from the first look at it on.
    ack_at: Nanos,
    /// Submessages of message `next` that were taken before one was not.
    taken: u16,
    stats: InputStats,
}

impl<S, R, const N: usize> InputReliable<S, R, N>
where
    S: AsRef<[u8]> + AsMut<[u8]>,
    R: AsRef<[u8]> + AsMut<[u8]>,
{
    /// A stream at its beginning. `slots` is cut into slots of `slot_size` bytes, at most `N` and
    /// 31; a slot holds a message without its header. The length of `fragments` is the largest
    /// submessage, header included, that can be put together.
    pub fn new(stream: StreamId, slots: S, slot_size: usize, fragments: R) -> Self {
        let slot_size = slot_size.min(usize::from(u16::MAX));
        let capacity = slots
            .as_ref()
            .len()
            .checked_div(slot_size)
            .unwrap_or(0)
            .min(N)
            .min(MOST);
        InputReliable {
            slots,
            slot_size,
            capacity,
            lens: [0; N],
            kept: 0,
            head: 0,
            next: SeqNum(0),
            announced: SeqNum(0).previous(),
            reassembly: Reassembly::new(fragments),
            stream,
            ack_due: false,
            policy: AckPolicy::IMMEDIATE,
            unconfirmed: 0,
            urgent: false,
            ack_at: NEVER,
            taken: 0,
            stats: InputStats::default(),
        }
    }

    /// The same with another policy for [`InputReliable::take_ack_at`].
    #[must_use]
    pub const fn acknowledging(mut self, policy: AckPolicy) -> Self {
        self.policy = policy;
        self
    }

    /// Back to the beginning, for a new session. The counters go on.
    pub fn reset(&mut self) {
        self.kept = 0;
        self.head = 0;
        self.next = SeqNum(0);
        self.announced = SeqNum(0).previous();
        self.taken = 0;
        self.reassembly.reset();
        self.acknowledged();
    }

    /// A message has arrived: `body` is what follows its header. Calls `deliver` with every
    /// submessage that is due now, this message's and those of kept ones, fragments put together.
    /// Of a submessage that is too long for that, `deliver` gets the beginning, as a `FRAGMENT`.
    pub fn receive(&mut self, seq: SeqNum, body: &[u8], mut deliver: impl FnMut(&Submessage<'_>)) {
        let mut taken = |submessage: &Submessage<'_>| {
            deliver(submessage);
            true
        };
        self.receive_with::<false>(seq, body, &mut taken);
    }

    pub(super) fn receive_with<const MAY_STOP: bool>(
        &mut self,
        seq: SeqNum,
        body: &[u8],
        deliver: &mut impl FnMut(&Submessage<'_>) -> bool,
    ) {
        self.ack_due = true;
        self.unconfirmed = self.unconfirmed.saturating_add(1);
        let ahead = seq.since(self.next);
        let Ok(ahead) = usize::try_from(ahead) else {
            self.urgent = true; // the acknowledgement was lost
            count(&mut self.stats.duplicates);
            return;
        };
        if seq.is_after(self.announced) {
            self.announced = seq;
        }
        if ahead > 0 {
            self.urgent = true;
            self.keep(ahead, body);
            return;
        }
        let Self {
            reassembly,
            stats,
            taken,
            ..
        } = self;
        if consume::<R, MAY_STOP>(body, reassembly, stats, taken, deliver) {
            let next = self.advance();
            self.go_on::<MAY_STOP>(next, deliver);
        }
    }

    /// Delivers kept messages, the first of them at `next`. One that is not taken stays: the sender
    /// may know that it has arrived.
    #[inline]
    pub(super) fn go_on<const MAY_STOP: bool>(
        &mut self,
        mut next: Option<(usize, usize)>,
        deliver: &mut impl FnMut(&Submessage<'_>) -> bool,
    ) {
        while let Some((start, end)) = next {
            let Self {
                reassembly,
                stats,
                taken,
                slots,
                ..
            } = self;
            if let Some(body) = slots.as_ref().get(start..end)
                && !consume::<R, MAY_STOP>(body, reassembly, stats, taken, deliver)
            {
                return;
            }
            next = self.advance();
        }
    }

    /// A heartbeat has arrived: the sender has sent everything up to `last`, and wants to know what
    /// has arrived.
    pub fn heartbeat(&mut self, last: SeqNum) {
        if last.is_after(self.announced) {
            self.announced = last;
        }
        self.ack_due = true;
        self.urgent = true;
    }

    /// The acknowledgement to send, if anything has arrived since the last one.
    pub fn take_ack(&mut self) -> Option<AckNack> {
        if !self.ack_due {
            return None;
        }
        self.acknowledged();
        Some(self.ack())
    }

    /// The acknowledgement to send by now, as the [`AckPolicy`] says.
    pub fn take_ack_at(&mut self, now: Nanos) -> Option<AckNack> {
        let at = self.ack_at.min(later(now, self.policy.delay));
        let due = self.urgent || self.unconfirmed >= self.policy.every || at <= now;
        if self.ack_due && !due {
            self.ack_at = at;
            return None;
        }
        self.take_ack()
    }

    /// Time at which [`InputReliable::take_ack_at`] has something to send, once it was asked;
    /// [`NEVER`] for nothing.
    pub(crate) const fn ack_due_at(&self) -> Nanos {
        self.ack_at
    }

    const fn acknowledged(&mut self) {
        self.ack_due = false;
        self.urgent = false;
        self.unconfirmed = 0;
        self.ack_at = NEVER;
    }

    /// Whether [`InputReliable::take_ack`] has something to send.
    pub const fn ack_due(&self) -> bool {
        self.ack_due
    }

    /// Whether the sender waits for an acknowledgement, or must learn of a gap.
    pub const fn is_urgent(&self) -> bool {
        self.urgent
    }

    /// The state as an acknowledgement.
    pub fn ack(&self) -> AckNack {
        // Messages known to exist: up to the last one that was announced, and that has a slot.
        let announced = self.announced.plus(1).since(self.next);
        let known = usize::try_from(announced).unwrap_or(0);
        let known = known.min(self.capacity.wrapping_add(1)).min(16);
        let all = u32::MAX.checked_shl(known as u32).unwrap_or(0);
        let missing = !(all | self.kept) as u16;
        AckNack {
            first_unacked: self.next,
            missing,
            stream: self.stream,
        }
    }

    /// The number of the first message that has not been handled.
    pub const fn next_expected(&self) -> SeqNum {
        self.next
    }

    /// The counters so far.
    pub const fn stats(&self) -> InputStats {
        self.stats
    }

    /// Begin of the message in slot `slot`.
    const fn start(&self, slot: usize) -> usize {
        slot.wrapping_mul(self.slot_size)
    }

    /// The slot after `slot`, or `ahead` after it, at most one round.
    pub(super) const fn slot(&self, ahead: usize) -> usize {
        let slot = self.head.wrapping_add(ahead);
        match slot.checked_sub(self.capacity) {
            Some(slot) => slot,
            None => slot,
        }
    }

    /// Keeps the message `ahead` (at least 1) after `next`.
    fn keep(&mut self, ahead: usize, body: &[u8]) {
        let bit = 1_u32.checked_shl(ahead as u32).unwrap_or(0);
        if self.kept & bit != 0 {
            count(&mut self.stats.duplicates);
            return;
        }
        let slot = self.slot(ahead.wrapping_sub(1));
        let start = self.start(slot);
        let room = self.slots.as_mut().get_mut(start..);
        // As long as a message is not taken, the last slot is its own.
        let free = self.capacity.wrapping_sub((self.kept & 1) as usize);
        let fits = ahead <= free && body.len() <= self.slot_size;
        let (true, Some(room), Some(len)) = (
            fits,
            room.and_then(|room| room.get_mut(..body.len())),
            self.lens.get_mut(slot),
        ) else {
            count(&mut self.stats.dropped);
            return;
        };
        room.copy_from_slice(body);
        *len = body.len() as u16;
        self.kept |= bit;
        count(&mut self.stats.reordered);
    }

    /// Steps over message `next`; gives where the message after it is kept, if it is.
    fn advance(&mut self) -> Option<(usize, usize)> {
        self.next = self.next.plus(1);
        let slot = self.head;
        self.head = self.slot(1);
        self.kept >>= 1;
        if self.kept & 1 == 0 {
            return None;
        }
        self.place(slot)
    }

    /// Begin and end of the message in slot `slot`.
    pub(super) fn place(&self, slot: usize) -> Option<(usize, usize)> {
        let len = usize::from(*self.lens.get(slot)?);
        let start = self.start(slot);
        Some((start, start.wrapping_add(len)))
    }
}

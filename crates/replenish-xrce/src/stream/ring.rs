//! The messages of a reliable output stream from the first unacknowledged one on, in a ring of
//! equal slots.

use super::push::{PushError, Tail, size_within};
use super::spill::Spill;
use crate::SeqNum;
use crate::features::{DELIVERY, FRAGMENTS};
use crate::time::{NEVER, Nanos};
use crate::wire::StreamHeader;
use crate::wire::{Encode, FLAG_LITTLE_ENDIAN, Fragment, SubmessageId, WireError, Writer};
use crate::wire::{append, encode_joined, joined_len};

/// Messages that one submessage may take: their numbers are compared over half a round of 2^16.
pub const MOST_FRAGMENTS: usize = 32_000;

/// The part of a submessage that a message holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Part {
    /// One or more whole submessages.
    #[default]
    Whole,
    /// The first fragment.
    First,
    /// A fragment between the first and the last.
    Middle,
    /// The last fragment.
    Last,
}

/// The state of one message.
#[derive(Clone, Copy, Debug)]
pub(super) struct RingSlot {
    /// Bytes of the message.
    pub(super) len: usize,
    /// More submessages may be appended.
    pub(super) open: bool,
    /// Time at which it was last sent.
    pub(super) sent_at: Nanos,
    /// Sent more than once.
    pub(super) resent: bool,
    /// Named missing: to be sent again from this time on.
    pub(super) lost: Nanos,
    /// Number of times that it was sent again since then.
    pub(super) retries: u8,
    /// The receiver has it, although not everything before it.
    pub(super) received: bool,
    /// The part of a submessage in it.
    pub(super) part: Part,
    /// The message is a fragment of the submessage in the spill.
    pub(super) spilled: bool,
}

impl Default for RingSlot {
    fn default() -> Self {
        RingSlot {
            len: 0,
            open: false,
            sent_at: 0,
            resent: false,
            lost: NEVER,
            retries: 0,
            received: false,
            part: Part::Whole,
            spilled: false,
        }
    }
}

/// A ring of at most `N` messages in `S`.
#[derive(Debug)]
pub(super) struct Ring<S, const N: usize> {
    pub(super) storage: S,
    pub(super) slot_size: usize,
    capacity: usize,
    slots: [RingSlot; N],
    pub(super) header: StreamHeader,
    /// Fragments stay until the last one of their sample is acknowledged.
    pub(super) keep_whole: bool,
    spill: Option<Spill<S>>,
    tail: Tail,
    head: usize,
    pub(super) first: SeqNum,
    pub(super) used: usize,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize> Ring<S, N> {
    pub(super) fn new(storage: S, mtu: usize, header: StreamHeader, tail: Tail) -> Self {
        let slot_size = mtu.clamp(16, usize::from(u16::MAX));
        let capacity = storage
            .as_ref()
            .len()
            .checked_div(slot_size)
            .unwrap_or(0)
            .min(N);
        Ring {
            storage,
            slot_size,
            capacity,
            slots: [RingSlot::default(); N],
            header,
            keep_whole: false,
            spill: None,
            tail,
            head: 0,
            first: SeqNum(0),
            used: 0,
        }
    }

    pub(super) fn reset(&mut self, header: StreamHeader) {
        self.header = header;
        self.head = 0;
        self.first = SeqNum(0);
        self.used = 0;
        if let Some(spill) = self.spill_mut() {
            spill.clear();
        }
    }

    /// Sets the spill, where submessages wait that are larger than the free part of the ring.
    pub(super) fn spill_to(&mut self, buf: S) {
        if FRAGMENTS {
            self.spill = Some(Spill::new(buf));
        }
    }

    pub(super) const fn spill(&self) -> Option<&Spill<S>> {
        if FRAGMENTS { self.spill.as_ref() } else { None }
    }

    pub(super) const fn spill_mut(&mut self) -> Option<&mut Spill<S>> {
        if FRAGMENTS { self.spill.as_mut() } else { None }
    }

    /// The largest submessage, header included, that can be pushed.
    pub(super) fn limit(&self) -> usize {
        if !FRAGMENTS {
            let one = self
                .slot_size
                .saturating_sub(self.header.session.header_len());
            return if self.capacity > 0 { one } else { 0 };
        }
        let by_ring = self.piece().saturating_mul(self.capacity);
        let by_spill = match self.spill() {
            Some(spill) if self.capacity > 0 => spill.room(),
            _ => 0,
        };
        let by_number = self.piece().saturating_mul(MOST_FRAGMENTS);
        by_ring.max(by_spill).min(by_number)
    }

    pub(super) const fn free(&self) -> usize {
        self.capacity.saturating_sub(self.used)
    }

    /// Forgets the first `n` messages.
    pub(super) fn release(&mut self, n: usize) {
        self.head = self.index(n);
        self.first = self.first.ahead(n);
        self.used = self.used.saturating_sub(n);
        self.refill();
    }

    /// Number of the first `n` messages that can be forgotten: all, or up to the first sample that
    /// has a fragment behind them.
    pub(super) fn complete(&self, n: usize) -> usize {
        if !DELIVERY || !FRAGMENTS || !self.keep_whole {
            return n;
        }
        let ends_a_sample = |i: &usize| {
            i.checked_sub(1)
                .and_then(|before| self.get(before))
                .is_none_or(|slot| slot.spilled || matches!(slot.part, Part::Whole | Part::Last))
        };
        (0..=n).rev().find(ends_a_sample).unwrap_or(0)
    }

    /// Message `first + i`, of `len` bytes, with its header: its number is certain only when it is
    /// sent.
    pub(super) fn stamp(&mut self, i: usize, len: usize) -> Option<&[u8]> {
        let start = self.index(i).wrapping_mul(self.slot_size);
        let storage = self.storage.as_mut();
        let message = storage.get_mut(start..start.wrapping_add(len))?;
        self.header.put(self.first.ahead(i), message);
        Some(message)
    }

    /// Message `first + i`.
    pub(super) fn get(&self, i: usize) -> Option<&RingSlot> {
        self.slots.get(self.index(i))
    }

    /// Message `first + i`.
    pub(super) fn get_mut(&mut self, i: usize) -> Option<&mut RingSlot> {
        let index = self.index(i);
        self.slots.get_mut(index)
    }

    /// The bytes of message `first + i`.
    pub(super) fn bytes(&self, i: usize) -> Option<&[u8]> {
        let start = self.index(i).wrapping_mul(self.slot_size);
        self.storage
            .as_ref()
            .get(start..start.wrapping_add(self.get(i)?.len))
    }

    /// See [`OutputReliable::push`](super::OutputReliable::push).
    pub(super) fn push<B: Encode + ?Sized>(&mut self, body: &B) -> Result<(), PushError> {
        if !FRAGMENTS {
            return self.push_whole(body);
        }
        let size = joined_len(body).map_err(PushError::Wire)?;
        let fits_one = size.wrapping_add(self.header.session.header_len()) <= self.slot_size;
        let count = if fits_one {
            1
        } else {
            size.div_ceil(self.piece().max(1))
        };
        let spills = !fits_one && self.spill().is_some_and(|s| size <= s.room());
        let spills = spills && count <= MOST_FRAGMENTS;
        if count > self.capacity && !(spills && self.capacity > 0) {
            return Err(PushError::TooLarge {
                size,
                limit: self.limit(),
            });
        }
        if self.spill().is_some_and(Spill::is_busy) {
            return Err(PushError::WouldBlock);
        }
        if self.append(body) {
            return Ok(());
        }
        if count > self.free() && !spills {
            return Err(PushError::WouldBlock);
        }
        if let Some(newest) = self.used.checked_sub(1).and_then(|i| self.get_mut(i)) {
            newest.open = false;
        }
        if count > self.free() {
            if let Some(spill) = self.spill_mut() {
                spill.fill(body, size).map_err(PushError::Wire)?;
            }
            self.refill();
            return Ok(());
        }
        if fits_one {
            self.begin();
            let appended = self.append(body);
            return appended.then_some(()).ok_or(PushError::WouldBlock);
        }
        let mut position = 0;
        for _ in 0..count {
            position = self.begin_fragment(position, size, false, |piece, position| {
                encode_joined(body, &mut Writer::window(piece, position))
            })?;
        }
        Ok(())
    }

    /// The same for a submessage that goes into one message or is refused.
    fn push_whole<B: Encode + ?Sized>(&mut self, body: &B) -> Result<(), PushError> {
        size_within(self.limit(), body)?;
        while !self.append(body) {
            if self.free() == 0 {
                return Err(PushError::WouldBlock);
            }
            self.begin();
        }
        Ok(())
    }

    /// Moves fragments from the spill into free messages.
    pub(super) fn refill(&mut self) {
        if !FRAGMENTS {
            return;
        }
        let Some(mut spill) = self.spill.take() else {
            return;
        };
        while self.free() > 0 && spill.position < spill.len {
            let moved = self.begin_fragment(spill.position, spill.len, true, |piece, position| {
                spill.copy(piece, position);
                Ok(())
            });
            match moved {
                Ok(position) => spill.position = position,
                Err(_) => break, // there was no room after all
            }
        }
        let is_kept = |i| self.get(i).is_some_and(|slot| slot.spilled);
        if spill.position >= spill.len && !(self.keep_whole && (0..self.used).any(is_kept)) {
            spill.clear();
        }
        self.spill = Some(spill);
    }

    /// Messages that the rest of the spill will take.
    pub(super) fn in_spill(&self) -> usize {
        let left = |spill: &Spill<S>| spill.len.saturating_sub(spill.position);
        let left = self.spill().map_or(0, left);
        left.div_ceil(self.piece().max(1))
    }

    /// Takes over the first `used` messages as they are now, none of which was sent.
    pub(super) const fn restart(&mut self, header: StreamHeader, used: usize) {
        self.header = header;
        self.first = SeqNum(0);
        self.used = used;
    }

    /// Moves the bytes and description of message `from` to `to`, `len` bytes long.
    pub(super) fn shift(&mut self, from: usize, to: usize, part: Part) {
        let Some(len) = self.get(from).map(|slot| slot.len) else {
            return;
        };
        let start = self.index(from).wrapping_mul(self.slot_size);
        let target = self.index(to).wrapping_mul(self.slot_size);
        let end = start.wrapping_add(len);
        if target.wrapping_add(len) <= self.storage.as_ref().len() {
            self.storage.as_mut().copy_within(start..end, target);
        }
        if let Some(slot) = self.get_mut(to) {
            *slot = RingSlot {
                len,
                part,
                ..RingSlot::default()
            };
        }
    }

    /// Bytes of a submessage that go into one fragment.
    pub(super) const fn piece(&self) -> usize {
        self.slot_size
            .saturating_sub(self.header.session.header_len())
            .saturating_sub(4)
    }

    /// The slot of message `first + i`, at most one round ahead.
    const fn index(&self, i: usize) -> usize {
        let index = self.head.wrapping_add(i);
        match index.checked_sub(self.capacity) {
            Some(index) => index,
            None => index,
        }
    }

    pub(super) fn room_of(&mut self, i: usize) -> Option<&mut [u8]> {
        let index = self.index(i);
        self.room(index)
    }

    fn room(&mut self, index: usize) -> Option<&mut [u8]> {
        let start = index.wrapping_mul(self.slot_size);
        self.storage
            .as_mut()
            .get_mut(start..start.wrapping_add(self.slot_size))
    }

    /// Appends to the newest message if that is open and has room.
    fn append<B: Encode + ?Sized>(&mut self, body: &B) -> bool {
        let Some(newest) = self.used.checked_sub(1) else {
            return false;
        };
        let (index, pad) = (self.index(newest), self.tail.is_padded());
        let Some(len) = self.slots.get(index).filter(|s| s.open).map(|s| s.len) else {
            return false;
        };
        let room = self.room(index).unwrap_or_default();
        let Some(len) = append(room, len, body, pad) else {
            return false;
        };
        if let Some(slot) = self.slots.get_mut(index) {
            slot.len = len;
        }
        true
    }

    /// Begins a message, with room for its header; the caller has checked that there is a free
    /// slot. Gives the room after the header.
    fn begin(&mut self) -> Option<&mut [u8]> {
        let index = self.index(self.used);
        let len = self.header.session.header_len();
        *self.slots.get_mut(index)? = RingSlot {
            len,
            open: true,
            ..RingSlot::default()
        };
        self.used = self.used.wrapping_add(1);
        self.room(index)?.get_mut(len..)
    }

    /// Begins a message that is one fragment of a submessage of `size` bytes, from `position` on,
    /// which `write` puts there; gives the position after it.
    fn begin_fragment(
        &mut self,
        position: usize,
        size: usize,
        spilled: bool,
        write: impl FnOnce(&mut [u8], usize) -> Result<(), WireError>,
    ) -> Result<usize, PushError> {
        let len = self.piece().min(size.saturating_sub(position));
        let end = position.wrapping_add(len);
        let (flag, part) = match (position, end >= size) {
            (_, true) => (Fragment::FLAG_LAST, Part::Last),
            (0, false) => (0, Part::First),
            (_, false) => (0, Part::Middle),
        };
        let [low, high] = u16::try_from(len).unwrap_or(0).to_le_bytes();
        let subheader = [
            SubmessageId::Fragment as u8,
            flag | FLAG_LITTLE_ENDIAN,
            low,
            high,
        ];
        let newest = self.used;
        let Some((front, piece)) = self.begin().and_then(<[u8]>::split_first_chunk_mut) else {
            return Err(PushError::WouldBlock);
        };
        *front = subheader;
        let piece = piece.get_mut(..len).unwrap_or(&mut []);
        write(piece, position).map_err(PushError::Wire)?;
        if let Some(slot) = self.get_mut(newest) {
            slot.len = slot.len.wrapping_add(subheader.len()).wrapping_add(len);
            slot.open = false;
            slot.part = part;
            slot.spilled = spilled;
        }
        Ok(end)
    }
}

//! The messages of a reliable output stream from the first unacknowledged one on, in a ring of
//! equal slots.

use super::{PushError, StreamHeader, Tail};
use crate::wire::{Encode, FLAG_LITTLE_ENDIAN, Fragment, MessageWriter, SubmessageId, WireError};
use crate::wire::{Writer, encode_submessage, submessage_len};
use crate::{Nanos, SeqNum};

/// One message and what is known about it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slot {
    /// Bytes of the message.
    pub(super) len: usize,
    /// More submessages may be appended.
    pub(super) open: bool,
    /// When it was last sent.
    pub(super) sent_at: Nanos,
    /// Sent more than once.
    pub(super) resent: bool,
    /// Named missing: to be sent again from this time on.
    pub(super) lost: Option<Nanos>,
    /// The receiver has it, although not everything before it.
    pub(super) received: bool,
}

/// A ring of at most `N` messages in `S`.
#[derive(Debug)]
pub(super) struct Ring<S, const N: usize> {
    storage: S,
    slot_size: usize,
    capacity: usize,
    slots: [Slot; N],
    pub(super) header: StreamHeader,
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
            slots: [Slot::default(); N],
            header,
            tail,
            head: 0,
            first: SeqNum(0),
            used: 0,
        }
    }

    pub(super) const fn reset(&mut self, header: StreamHeader) {
        self.header = header;
        self.head = 0;
        self.first = SeqNum(0);
        self.used = 0;
    }

    /// Header, body of 65535 bytes, and padding.
    const LONGEST: usize = 4 + 65536;

    /// The largest submessage, header included, that can be pushed.
    pub(super) const fn limit(&self) -> usize {
        let by_ring = self.piece().saturating_mul(self.capacity);
        if by_ring < Self::LONGEST {
            by_ring
        } else {
            Self::LONGEST
        }
    }

    pub(super) const fn free(&self) -> usize {
        self.capacity.saturating_sub(self.used)
    }

    /// Forgets the first `n` messages.
    pub(super) fn release(&mut self, n: usize) {
        self.head = self.index(n);
        self.first = self.first.plus(u16::try_from(n).unwrap_or(0));
        self.used = self.used.saturating_sub(n);
    }

    /// Message `first + i`.
    pub(super) fn get(&self, i: usize) -> Option<&Slot> {
        self.slots.get(self.index(i))
    }

    /// Message `first + i`.
    pub(super) fn get_mut(&mut self, i: usize) -> Option<&mut Slot> {
        let index = self.index(i);
        self.slots.get_mut(index)
    }

    /// The bytes of message `first + i`.
    pub(super) fn bytes(&self, i: usize) -> Option<&[u8]> {
        let start = self.index(i).saturating_mul(self.slot_size);
        self.storage
            .as_ref()
            .get(start..start.saturating_add(self.get(i)?.len))
    }

    /// See [`OutputReliable::push`](super::OutputReliable::push).
    pub(super) fn push(&mut self, body: &impl Encode) -> Result<(), PushError> {
        let size = submessage_len(body).map_err(PushError::Wire)?;
        if self.append(body)? {
            return Ok(());
        }
        let fits_one = size.saturating_add(self.header.len()) <= self.slot_size;
        let count = if fits_one {
            1
        } else {
            size.div_ceil(self.piece().max(1))
        };
        if count > self.capacity {
            return Err(PushError::TooLarge {
                size,
                limit: self.limit(),
            });
        }
        if count > self.free() {
            return Err(PushError::WouldBlock);
        }
        if let Some(newest) = self.used.checked_sub(1).and_then(|i| self.get_mut(i)) {
            newest.open = false;
        }
        if fits_one {
            self.begin()?;
            return self.append(body).map(|_| ());
        }
        let mut position = 0;
        for _ in 0..count {
            position = self.begin_fragment(body, position, size)?;
        }
        Ok(())
    }

    /// Bytes of a submessage that go into one fragment.
    const fn piece(&self) -> usize {
        self.slot_size
            .saturating_sub(self.header.len())
            .saturating_sub(4)
    }

    fn index(&self, i: usize) -> usize {
        self.head
            .saturating_add(i)
            .checked_rem(self.capacity)
            .unwrap_or(0)
    }

    fn room(&mut self, index: usize) -> Option<&mut [u8]> {
        let start = index.saturating_mul(self.slot_size);
        self.storage
            .as_mut()
            .get_mut(start..start.saturating_add(self.slot_size))
    }

    /// Appends to the newest message if that is open and has room.
    fn append(&mut self, body: &impl Encode) -> Result<bool, PushError> {
        let Some(index) = self.used.checked_sub(1).map(|i| self.index(i)) else {
            return Ok(false);
        };
        let Some(len) = self
            .slots
            .get(index)
            .filter(|slot| slot.open)
            .map(|slot| slot.len)
        else {
            return Ok(false);
        };
        let tail = self.tail;
        let mut writer = MessageWriter::resume(self.room(index).unwrap_or(&mut []), len);
        let pushed = match tail {
            Tail::Padded => writer.push_padded(body),
            Tail::Exact => writer.push(body),
        };
        match pushed.map(|()| writer.len()) {
            Ok(len) => {
                self.slots
                    .get_mut(index)
                    .into_iter()
                    .for_each(|slot| slot.len = len);
                Ok(true)
            }
            Err(WireError::NoRoom { .. }) => Ok(false),
            Err(error) => Err(PushError::Wire(error)),
        }
    }

    /// Begins a message with its header; the caller has checked that there is a free slot. Gives
    /// the room after the header.
    fn begin(&mut self) -> Result<&mut [u8], PushError> {
        let index = self.index(self.used);
        let header = self
            .header
            .at(self.first.plus(u16::try_from(self.used).unwrap_or(0)));
        let room = self.room(index).ok_or(PushError::WouldBlock)?;
        header
            .encode(&mut Writer::new(room))
            .map_err(PushError::Wire)?;
        if let Some(slot) = self.slots.get_mut(index) {
            *slot = Slot {
                len: header.len(),
                open: true,
                ..Slot::default()
            };
        }
        self.used = self.used.saturating_add(1);
        let room = self
            .room(index)
            .and_then(|room| room.get_mut(header.len()..));
        room.ok_or(PushError::WouldBlock)
    }

    /// Begins a message that is one fragment of `body`'s submessage, from `position` on; gives the
    /// position after it.
    fn begin_fragment(
        &mut self,
        body: &impl Encode,
        position: usize,
        size: usize,
    ) -> Result<usize, PushError> {
        let len = self.piece().min(size.saturating_sub(position));
        let end = position.saturating_add(len);
        let last = if end >= size { Fragment::FLAG_LAST } else { 0 };
        let [low, high] = u16::try_from(len).unwrap_or(0).to_le_bytes();
        let subheader = [
            SubmessageId::Fragment as u8,
            last | FLAG_LITTLE_ENDIAN,
            low,
            high,
        ];
        let newest = self.used;
        let room = self.begin()?;
        let Some((front, piece)) = room.split_at_mut_checked(subheader.len()) else {
            return Err(PushError::WouldBlock);
        };
        front.copy_from_slice(&subheader);
        let piece = piece.get_mut(..len).unwrap_or(&mut []);
        encode_submessage(body, true, &mut Writer::window(piece, position))
            .map_err(PushError::Wire)?;
        if let Some(slot) = self.get_mut(newest) {
            slot.len = slot.len.saturating_add(subheader.len()).saturating_add(len);
            slot.open = false;
        }
        Ok(end)
    }
}

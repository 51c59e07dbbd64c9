//! ACKNACK, HEARTBEAT, FRAGMENT and RESET: the submessages of reliable streams.
//!
//! ACKNACK and HEARTBEAT travel outside of streams (stream 0, number 0) and name the stream they
//! are about: an ACKNACK names the sender's input stream, a HEARTBEAT the sender's output stream.

use super::{Encode, SubmessageId};
use super::{Reader, StreamId, WireError, Writer};
use crate::SeqNum;

/// ACKNACK: all messages before `first_unacked` have arrived; of the sixteen from there on the
/// `missing` ones have not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AckNack {
    /// The first message that has not arrived.
    pub first_unacked: SeqNum,
    /// Bit `i` set: message `first_unacked + i` is known to exist and has not arrived. Big endian
    /// on the wire whatever the byte order flag says.
    pub missing: u16,
    /// The stream.
    pub stream: StreamId,
}

impl Encode for AckNack {
    fn id(&self) -> SubmessageId {
        SubmessageId::AckNack
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.put(&self.to_bytes());
    }
}

impl AckNack {
    pub(crate) const fn to_bytes(self) -> [u8; 5] {
        let [a, b] = self.first_unacked.0.to_le_bytes();
        let [c, d] = self.missing.to_be_bytes();
        [a, b, c, d, self.stream.0]
    }

    /// Reads it from a body; `None` if that is too short.
    pub(crate) fn of(body: &[u8], little_endian: bool) -> Option<Self> {
        let [a, b, c, d, stream] = five(body, little_endian)?;
        Some(AckNack {
            first_unacked: SeqNum(number([a, b], little_endian)),
            missing: u16::from_be_bytes([c, d]),
            stream: StreamId(stream),
        })
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let (body, little_endian) = (r.rest(), r.little_endian());
        Self::of(body, little_endian).ok_or(short(body))
    }
}

const fn short(body: &[u8]) -> WireError {
    WireError::Truncated {
        needed: 5,
        left: body.len(),
    }
}

const fn number(bytes: [u8; 2], little_endian: bool) -> u16 {
    let number = u16::from_le_bytes(bytes);
    if little_endian {
        number
    } else {
        number.swap_bytes()
    }
}

/// The five bytes of an ACKNACK or HEARTBEAT. The length that the specification puts before an
/// appendable structure (XCDR2's DHEADER), and that eProsima's implementations leave out, is
/// stepped over if it is there.
fn five(body: &[u8], little_endian: bool) -> Option<[u8; 5]> {
    let length = if little_endian { 5 } else { 5 << 24 };
    let rest = match body {
        [a, b, c, d, rest @ ..] if u32::from_le_bytes([*a, *b, *c, *d]) == length => rest,
        _ => &[],
    };
    rest.first_chunk().or(body.first_chunk()).copied()
}

/// An ACKNACK that may also say which messages are *confirmed*.
///
/// A confirmed message has reached all its readers, not just the agent. This is an extension of
/// the project, sent only to clients that ask for it with the property [`DELIVERY`]: other decoders
/// expect exactly five bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Confirmation {
    /// The acknowledgement, for every client.
    pub ack: AckNack,
    /// The confirmation, for clients that ask for it.
    pub confirmed: Option<Confirmed>,
}

/// The part that a [`Confirmation`] adds to an ACKNACK.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Confirmed {
    /// The first message that is not confirmed; never after the first one that is not acknowledged.
    pub first_unconfirmed: SeqNum,
    /// Clients of the agent that ask for confirmations, up to 255: as many will return if the agent
    /// is lost.
    pub companions: u8,
}

/// The property of a log-in that asks for [`Confirmation::confirmed`], and of the answer that
/// grants it.
pub const DELIVERY: &str = "replenish.delivery";
/// Value of [`DELIVERY`]: a client that has no samples from before.
pub const DELIVERY_NEW: &str = "new";
/// Begin of a value of [`DELIVERY`]: a client that lost its agent and repeats unconfirmed samples.
///
/// The last [`Confirmed::companions`] follows as two hexadecimal digits.
pub const DELIVERY_BACK: &str = "back:";
/// Value of [`DELIVERY`] in the agent's answer.
pub const DELIVERY_CONFIRMED: &str = "settled";

impl Confirmed {
    /// Reads it from the payload of an ACKNACK, if the agent has appended one.
    pub(super) fn of(payload: &[u8], little_endian: bool) -> Option<Self> {
        let &[companions, a, b] = payload.get(5..8)? else {
            return None;
        };
        Some(Confirmed {
            first_unconfirmed: SeqNum(number([a, b], little_endian)),
            companions,
        })
    }
}

impl Encode for Confirmation {
    fn id(&self) -> SubmessageId {
        SubmessageId::AckNack
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.ack.write(w);
        let Some(confirmed) = self.confirmed else {
            return;
        };
        w.u8(confirmed.companions);
        w.u16(confirmed.first_unconfirmed.0);
    }
}

/// HEARTBEAT: the messages that the sender keeps; asks for an ACKNACK.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// The first message that is not acknowledged.
    pub first: SeqNum,
    /// The last message that was sent.
    pub last: SeqNum,
    /// The stream.
    pub stream: StreamId,
}

impl Encode for Heartbeat {
    fn id(&self) -> SubmessageId {
        SubmessageId::Heartbeat
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.put(&self.to_bytes());
    }
}

impl Heartbeat {
    pub(crate) const fn to_bytes(self) -> [u8; 5] {
        let ([a, b], [c, d]) = (self.first.0.to_le_bytes(), self.last.0.to_le_bytes());
        [a, b, c, d, self.stream.0]
    }

    /// Reads it from a body; `None` if that is too short.
    pub(crate) fn of(body: &[u8], little_endian: bool) -> Option<Self> {
        let [a, b, c, d, stream] = five(body, little_endian)?;
        Some(Heartbeat {
            first: SeqNum(number([a, b], little_endian)),
            last: SeqNum(number([c, d], little_endian)),
            stream: StreamId(stream),
        })
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let (body, little_endian) = (r.rest(), r.little_endian());
        Self::of(body, little_endian).ok_or(short(body))
    }
}

/// FRAGMENT: a piece of a submessage (header included) that is longer than a message may be. Only
/// on reliable streams; the pieces are consecutive messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fragment<'a> {
    /// The last piece.
    pub last: bool,
    /// The piece.
    pub piece: &'a [u8],
}

impl Fragment<'_> {
    pub(crate) const FLAG_LAST: u8 = 0x02;
}

impl Encode for Fragment<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::Fragment
    }

    fn flags(&self) -> u8 {
        if self.last { Self::FLAG_LAST } else { 0 }
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.put(self.piece);
    }
}

impl<'a> Fragment<'a> {
    pub(super) fn decode(r: &mut Reader<'a>, flags: u8) -> Self {
        Fragment {
            last: flags & Self::FLAG_LAST != 0,
            piece: r.rest(),
        }
    }
}

/// RESET: asks the receiver to start its streams anew. No implementation sends it; it is decoded
/// so that it can be counted and ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset;

impl Encode for Reset {
    fn id(&self) -> SubmessageId {
        SubmessageId::Reset
    }

    fn write(&self, _w: &mut Writer<'_>) {}
}

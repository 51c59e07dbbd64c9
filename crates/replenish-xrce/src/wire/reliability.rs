//! ACKNACK, HEARTBEAT, FRAGMENT and RESET: what makes streams reliable.
//!
//! ACKNACK and HEARTBEAT travel outside of streams (stream 0, number 0) and name the stream they
//! are about: an ACKNACK names the sender's input stream, a HEARTBEAT the sender's output stream.

use super::{Encode, FLAG_LITTLE_ENDIAN, Submessage, SubmessageId};
use super::{Reader, StreamId, WireError, Writer};
use crate::SeqNum;

/// ACKNACK: everything before `first_unacked` has arrived, and what of the sixteen messages from
/// there on is missing.
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

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        w.u16(self.first_unacked.0)?;
        w.put(&self.missing.to_be_bytes())?;
        w.u8(self.stream.0)
    }
}

impl AckNack {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        r.skip_length(5)?;
        Ok(AckNack {
            first_unacked: SeqNum(r.u16()?),
            missing: u16::from_be_bytes(r.array()?),
            stream: StreamId(r.u8()?),
        })
    }
}

/// An ACKNACK that may say more: which messages are *settled*, that is, have reached everybody they
/// are for, and not just the agent. An extension of this project, sent only to clients that ask for
/// it with the property [`DELIVERY`]: other decoders expect exactly five bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Confirmation {
    /// What every client is told.
    pub ack: AckNack,
    /// What clients that ask are told besides.
    pub settled: Option<Settled>,
}

/// What a [`Confirmation`] adds to an ACKNACK.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settled {
    /// The first message that is not settled; never after the first one that is not acknowledged.
    pub first_unsettled: SeqNum,
    /// Clients of the agent that have asked to be told, up to 255: as many will return if the agent
    /// is lost.
    pub companions: u8,
}

/// The property of a log-in that asks for [`Confirmation::settled`], and of the agent's answer that
/// promises it.
pub const DELIVERY: &str = "replenish.delivery";
/// Value of [`DELIVERY`]: a client that has no samples from before.
pub const DELIVERY_NEW: &str = "new";
/// Begin of a value of [`DELIVERY`]: a client that had a session, lost its agent and will repeat what
/// was not settled. What follows is the number of [`Settled::companions`] it was told last, as two
/// hexadecimal digits.
pub const DELIVERY_BACK: &str = "back:";
/// Value of [`DELIVERY`] in the agent's answer.
pub const DELIVERY_SETTLED: &str = "settled";

impl Confirmation {
    /// Where `settled` is in the payload, and where the payload ends.
    const SETTLED: core::ops::Range<usize> = 5..8;

    /// What the ACKNACK `submessage` says to be settled, if it does.
    #[must_use]
    pub fn settled_in(submessage: &Submessage<'_>) -> Option<Settled> {
        let &[companions, a, b] = submessage.payload.get(Self::SETTLED)? else {
            return None;
        };
        let little = submessage.flags & FLAG_LITTLE_ENDIAN != 0;
        let first = if little {
            u16::from_le_bytes([a, b])
        } else {
            u16::from_be_bytes([a, b])
        };
        Some(Settled {
            first_unsettled: SeqNum(first),
            companions,
        })
    }
}

impl Encode for Confirmation {
    fn id(&self) -> SubmessageId {
        SubmessageId::AckNack
    }

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        self.ack.encode(w)?;
        let Some(settled) = self.settled else {
            return Ok(());
        };
        w.u8(settled.companions)?;
        w.u16(settled.first_unsettled.0)
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

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        w.u16(self.first.0)?;
        w.u16(self.last.0)?;
        w.u8(self.stream.0)
    }
}

impl Heartbeat {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        r.skip_length(5)?;
        Ok(Heartbeat {
            first: SeqNum(r.u16()?),
            last: SeqNum(r.u16()?),
            stream: StreamId(r.u8()?),
        })
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

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        w.put(self.piece)
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

    fn encode(&self, _w: &mut Writer<'_>) -> Result<(), WireError> {
        Ok(())
    }
}

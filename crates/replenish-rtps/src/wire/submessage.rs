//! Bodies of submessages (RTPS 2.5, 9.4.5).

use super::sets::{FragmentSet, SequenceNumber, SequenceSet, bounded, sequence_number};
use super::shared::{self, Reference, Shared};
use super::{EntityId, GuidPrefix, Parameters, Reader, Timestamp, WireError};

pub(super) mod id {
    pub(crate) const PAD: u8 = 0x01;
    pub(crate) const ACKNACK: u8 = 0x06;
    pub(crate) const HEARTBEAT: u8 = 0x07;
    pub(crate) const GAP: u8 = 0x08;
    pub(crate) const INFO_TS: u8 = 0x09;
    pub(crate) const INFO_SRC: u8 = 0x0c;
    pub(crate) const INFO_DST: u8 = 0x0e;
    pub(crate) const NACK_FRAG: u8 = 0x12;
    pub(crate) const HEARTBEAT_FRAG: u8 = 0x13;
    pub(crate) const DATA: u8 = 0x15;
    pub(crate) const DATA_FRAG: u8 = 0x16;
}

/// Bit 0 of every submessage's flags: little endian.
pub(super) const LITTLE_ENDIAN: u8 = 1;

/// A submessage.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Submessage<'a> {
    /// Nothing.
    Pad,
    /// The samples that a reader has and lacks.
    AckNack(AckNack),
    /// The range of samples that a writer has.
    Heartbeat(Heartbeat),
    /// Samples that will not come.
    Gap(Gap),
    /// The source's time of the samples that follow, or none.
    InfoTimestamp(Option<Timestamp>),
    /// The participant that the submessages that follow are from.
    InfoSource(GuidPrefix),
    /// The participant that the submessages that follow are for; zeros: every one.
    InfoDestination(GuidPrefix),
    /// Fragments that a reader lacks.
    NackFrag(NackFrag),
    /// Fragments that a writer has sent.
    HeartbeatFrag(HeartbeatFrag),
    /// A sample.
    Data(Data<'a>),
    /// A part of a sample.
    DataFrag(DataFrag<'a>),
    /// A sample that its reader fetches from the writer's memory.
    Reference(Reference<'a>),
    /// Whether a reader takes references.
    Shared(Shared),
    /// A submessage that this crate does not know; to be skipped.
    Other(u8),
}

/// The samples that a reader has and lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AckNack {
    /// The reader.
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// Everything below the base has arrived; the set is missing.
    pub state: SequenceSet,
    /// Increases with every ACKNACK of the reader to the writer.
    pub count: u32,
    /// The reader needs no heartbeat as an answer.
    pub final_flag: bool,
}

/// The range of samples that a writer has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// The reader, or [`EntityId::UNKNOWN`].
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The first sample that the writer has, from 1.
    pub first: SequenceNumber,
    /// The last sample; `first - 1` if there is none.
    pub last: SequenceNumber,
    /// Increases with every heartbeat.
    pub count: u32,
    /// The reader need not answer if it lacks nothing.
    pub final_flag: bool,
    /// The heartbeat asserts the writer's liveliness.
    pub liveliness: bool,
}

/// Samples that will not come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// The reader, or [`EntityId::UNKNOWN`].
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The first one, from 1; all up to the set's base belong to the gap.
    pub start: SequenceNumber,
    /// More of them, from the base on.
    pub list: SequenceSet,
}

/// Fragments that a reader lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NackFrag {
    /// The reader.
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The sample.
    pub sn: SequenceNumber,
    /// The missing fragments.
    pub state: FragmentSet,
    /// Increases with every `NACK_FRAG` of the reader to the writer.
    pub count: u32,
}

/// Fragments that a writer has sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeartbeatFrag {
    /// The reader, or [`EntityId::UNKNOWN`].
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The sample.
    pub sn: SequenceNumber,
    /// The last fragment there is yet, from 1.
    pub last: u32,
    /// Increases with every `HEARTBEAT_FRAG`.
    pub count: u32,
}

/// The content of a DATA besides its inline QoS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload<'a> {
    /// Only inline QoS.
    None,
    /// A serialized sample with its encapsulation.
    Data(&'a [u8]),
    /// A serialized key with its encapsulation.
    Key(&'a [u8]),
}

/// A sample.
#[derive(Clone, Copy, Debug)]
pub struct Data<'a> {
    /// The reader, or [`EntityId::UNKNOWN`].
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The sample's number, from 1.
    pub sn: SequenceNumber,
    /// Parameters in the message itself.
    pub inline_qos: Option<Parameters<'a>>,
    /// The sample.
    pub payload: Payload<'a>,
}

/// A part of a sample.
#[derive(Clone, Copy, Debug)]
pub struct DataFrag<'a> {
    /// The reader, or [`EntityId::UNKNOWN`].
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The sample's number, from 1.
    pub sn: SequenceNumber,
    /// The first fragment, from 1.
    pub start: u32,
    /// Fragments, from 1.
    pub count: u16,
    /// Bytes of every fragment but the sample's last, from 1.
    pub fragment_size: u16,
    /// Bytes of the whole sample, with its encapsulation.
    pub sample_size: u32,
    /// Whether the fragments make a key, not a sample.
    pub key: bool,
    /// Parameters in the message itself.
    pub inline_qos: Option<Parameters<'a>>,
    /// The fragments' bytes.
    pub payload: &'a [u8],
}

impl<'a> Submessage<'a> {
    pub(super) fn decode(id: u8, flags: u8, body: &'a [u8], ours: bool) -> Result<Self, WireError> {
        let mut r = Reader::new(body, flags & LITTLE_ENDIAN != 0);
        let second = flags & 2 != 0;
        Ok(match id {
            id::PAD => Submessage::Pad,
            id::ACKNACK => Submessage::AckNack(AckNack {
                reader: EntityId::decode(&mut r)?,
                writer: EntityId::decode(&mut r)?,
                state: SequenceSet::decode(&mut r)?,
                count: r.u32()?,
                final_flag: second,
            }),
            id::HEARTBEAT => Submessage::Heartbeat(heartbeat(&mut r, flags)?),
            id::GAP => Submessage::Gap(Gap {
                reader: EntityId::decode(&mut r)?,
                writer: EntityId::decode(&mut r)?,
                start: bounded(&mut r, 1, "gapStart (from 1)")?,
                list: SequenceSet::decode(&mut r)?,
            }),
            id::INFO_TS if second => Submessage::InfoTimestamp(None),
            id::INFO_TS => Submessage::InfoTimestamp(Some(Timestamp::decode(&mut r)?)),
            id::INFO_SRC => {
                r.take(8)?; // unused, version, vendor
                Submessage::InfoSource(GuidPrefix(r.array()?))
            }
            id::INFO_DST => Submessage::InfoDestination(GuidPrefix(r.array()?)),
            id::NACK_FRAG => Submessage::NackFrag(NackFrag {
                reader: EntityId::decode(&mut r)?,
                writer: EntityId::decode(&mut r)?,
                sn: bounded(&mut r, 1, "writerSN (from 1)")?,
                state: FragmentSet::decode(&mut r)?,
                count: r.u32()?,
            }),
            id::HEARTBEAT_FRAG => Submessage::HeartbeatFrag(HeartbeatFrag {
                reader: EntityId::decode(&mut r)?,
                writer: EntityId::decode(&mut r)?,
                sn: bounded(&mut r, 1, "writerSN (from 1)")?,
                last: r.u32()?,
                count: r.u32()?,
            }),
            id::DATA => Submessage::Data(data(&mut r, flags)?),
            id::DATA_FRAG => Submessage::DataFrag(data_frag(&mut r, flags)?),
            other if ours => {
                let (reference, shared) = (Submessage::Reference, Submessage::Shared);
                let known = shared::decode(other, flags, r, reference, shared)?;
                known.unwrap_or(Submessage::Other(other))
            }
            other => Submessage::Other(other),
        })
    }
}

fn heartbeat(r: &mut Reader<'_>, flags: u8) -> Result<Heartbeat, WireError> {
    let (reader, writer) = (EntityId::decode(r)?, EntityId::decode(r)?);
    // Cyclone says 1 and 0 before its first sample; RustDDS has said 0 and 0.
    let first = bounded(r, 0, "firstSN (from 1)")?;
    let last = sequence_number(r)?;
    if last < first.saturating_sub(1) || last > super::MAX_SEQUENCE_NUMBER {
        return Err(WireError::OutOfRange("lastSN (from firstSN - 1)"));
    }
    Ok(Heartbeat {
        reader,
        writer,
        first: first.max(1),
        last: last.max(0),
        count: r.u32()?,
        final_flag: flags & 2 != 0,
        liveliness: flags & 4 != 0,
    })
}

/// Extra flags and the distance to the inline QoS, which later versions may make longer.
fn inline_qos_at(r: &mut Reader<'_>) -> Result<usize, WireError> {
    r.u16()?;
    let skip = usize::from(r.u16()?);
    Ok(r.left().saturating_sub(skip))
}

/// Steps over header fields of later versions and over the inline QoS.
fn inline_qos<'a>(
    r: &mut Reader<'a>,
    left: usize,
    present: bool,
) -> Result<Option<Parameters<'a>>, WireError> {
    let Some(skip) = r.left().checked_sub(left) else {
        return Err(WireError::OutOfRange("octetsToInlineQos"));
    };
    r.take(skip)?;
    if !present {
        return Ok(None);
    }
    let little = r.little_endian();
    let list = Parameters::new(Reader::new(r.rest(), little));
    *r = list.after()?;
    Ok(Some(list))
}

fn data<'a>(r: &mut Reader<'a>, flags: u8) -> Result<Data<'a>, WireError> {
    let left = inline_qos_at(r)?;
    let (reader, writer) = (EntityId::decode(r)?, EntityId::decode(r)?);
    let sn = bounded(r, 1, "writerSN (from 1)")?;
    let inline_qos = inline_qos(r, left, flags & 2 != 0)?;
    let payload = match flags & 0x0c {
        0 => Payload::None,
        0x04 => Payload::Data(r.rest()),
        0x08 => Payload::Key(r.rest()),
        _ => return Err(WireError::OutOfRange("flags (data or key)")),
    };
    Ok(Data {
        reader,
        writer,
        sn,
        inline_qos,
        payload,
    })
}

fn data_frag<'a>(r: &mut Reader<'a>, flags: u8) -> Result<DataFrag<'a>, WireError> {
    let left = inline_qos_at(r)?;
    let (reader, writer) = (EntityId::decode(r)?, EntityId::decode(r)?);
    let sn = bounded(r, 1, "writerSN (from 1)")?;
    let start = r.u32()?;
    let (count, fragment_size) = (r.u16()?, r.u16()?);
    let sample_size = r.u32()?;
    if count == 0 || fragment_size == 0 {
        return Err(WireError::OutOfRange("fragmentsInSubmessage, fragmentSize"));
    }
    let fragments = sample_size.div_ceil(u32::from(fragment_size));
    let last = u64::from(start).saturating_add(u64::from(count)) - 1;
    if start == 0 || last > u64::from(fragments) {
        return Err(WireError::OutOfRange("fragmentStartingNum"));
    }
    let inline_qos = inline_qos(r, left, flags & 2 != 0)?;
    let payload = r.rest();
    let from = u64::from(start - 1) * u64::from(fragment_size);
    let to = (last * u64::from(fragment_size)).min(u64::from(sample_size));
    let needed = usize::try_from(to.saturating_sub(from)).unwrap_or(usize::MAX);
    let Some(payload) = payload.get(..needed) else {
        return Err(WireError::Truncated {
            needed,
            left: payload.len(),
        });
    };
    Ok(DataFrag {
        reader,
        writer,
        sn,
        start,
        count,
        fragment_size,
        sample_size,
        key: flags & 4 != 0,
        inline_qos,
        payload,
    })
}

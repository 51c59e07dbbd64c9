//! Samples in memory that a writer shares with programs on its host: submessages of ours.
//!
//! ```text
//!   REFERENCE 0x90   writer to reader: a sample's number, its length, and its place in the memory
//!   SHARED    0x91   reader to writer: whether references are understood instead of fragments
//! ```
//!
//! Both are vendor-specific (RTPS 2.5, 9.4.5.1.1), bear a mark of this library, and go to none but
//! endpoints that have said that they know them.

use super::parameters::Parameters;
use super::sets::bounded;
use super::{EntityId, Reader, SequenceNumber, WireError, Writer};

pub(super) const REFERENCE: u8 = 0x90;
pub(super) const SHARED: u8 = 0x91;
pub(super) const MARK: [u8; 4] = *b"rpl1";

/// The name of a writer's memory, which means something to the operating system's edge alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SegmentName(pub [u8; 16]);

impl SegmentName {
    /// Reads the value of its parameter; `None` if that is not one of this library.
    pub(super) fn decode(r: &mut Reader<'_>) -> Option<Self> {
        let marked = r.array::<4>().is_ok_and(|mark| mark == MARK);
        r.array().ok().filter(|_| marked).map(SegmentName)
    }

    pub(super) fn encode(self, w: &mut Writer<'_>) {
        w.put(&MARK);
        w.put(&self.0);
    }
}

/// The place of a sample in the memory of its writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SharedPlace {
    /// The slot.
    pub slot: u32,
    /// The slot's stamp as long as it has this sample.
    pub stamp: u64,
}

/// A sample that its reader fetches from the memory of the writer.
#[derive(Clone, Copy, Debug)]
pub struct Reference<'a> {
    /// The reader, or [`EntityId::UNKNOWN`].
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The sample's number, from 1.
    pub sn: SequenceNumber,
    /// Bytes of the sample, with its encapsulation, from 1.
    pub sample_size: u32,
    /// The place of its bytes.
    pub place: SharedPlace,
    /// Bytes of a fragment, from 1, should it be asked for in fragments.
    pub fragment_size: u16,
    /// Parameters in the message itself.
    pub inline_qos: Option<Parameters<'a>>,
}

/// A reader says whether it takes references to samples of a writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shared {
    /// The reader.
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// Whether it takes them.
    pub taken: bool,
}

/// Reads a submessage of this library and makes a `T` of it; `None` for others.
pub(super) fn decode<'a, T>(
    id: u8,
    flags: u8,
    mut r: Reader<'a>,
    of_reference: impl FnOnce(Reference<'a>) -> T,
    of_shared: impl FnOnce(Shared) -> T,
) -> Result<Option<T>, WireError> {
    if !matches!(id, REFERENCE | SHARED) || r.array::<4>() != Ok(MARK) {
        return Ok(None);
    }
    let (reader, writer) = (EntityId::decode(&mut r)?, EntityId::decode(&mut r)?);
    let second = flags & 2 != 0;
    if id == SHARED {
        let taken = second;
        return Ok(Some(of_shared(Shared {
            reader,
            writer,
            taken,
        })));
    }
    let sn = bounded(&mut r, 1, "writerSN (from 1)")?;
    let (sample_size, slot) = (r.u32()?, r.u32()?);
    let (high, low) = (u64::from(r.u32()?), u64::from(r.u32()?));
    let (fragment_size, _) = (r.u16()?, r.u16()?);
    if fragment_size == 0 || sample_size == 0 {
        return Err(WireError::OutOfRange("sampleSize, fragmentSize"));
    }
    let inline_qos = if second {
        let list = Parameters::new(Reader::new(r.rest(), r.little_endian()));
        list.after()?;
        Some(list)
    } else {
        None
    };
    Ok(Some(of_reference(Reference {
        reader,
        writer,
        sn,
        sample_size,
        place: SharedPlace {
            slot,
            stamp: (high << 32) | low,
        },
        fragment_size,
        inline_qos,
    })))
}

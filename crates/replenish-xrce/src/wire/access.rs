//! `WRITE_DATA`, `READ_DATA` and DATA: samples up, the request for samples, samples down.

use super::header::SUBHEADER;
use super::{BaseRequest, Reader, StreamId, WireError, Writer};
use super::{Encode, SubmessageId};

const FORMAT_MASK: u8 = 0x0e;

fn plain(flags: u8) -> Result<(), WireError> {
    match flags & FORMAT_MASK {
        0 => Ok(()),
        other => Err(WireError::UnknownDataFormat(other)),
    }
}

/// `WRITE_DATA`: one sample for a data writer, requester or replier. The payload is CDR without
/// encapsulation header and starts its own alignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteData<'a> {
    /// The writer.
    pub base: BaseRequest,
    /// The sample.
    pub payload: &'a [u8],
}

impl Encode for WriteData<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::WriteData
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.put(self.payload);
    }
}

impl<'a> WriteData<'a> {
    /// The beginning of a whole submessage, header included, if it is this one, and the bytes of
    /// its whole sample; `None` for them where the header does not say.
    pub fn of_beginning(bytes: &'a [u8]) -> Option<(Self, Option<usize>)> {
        let (&[id, _, low, high], rest) = bytes.split_first_chunk::<SUBHEADER>()?;
        let (base, payload) = BaseRequest::split(rest)?;
        if SubmessageId::from_number(id) != Ok(SubmessageId::WriteData) {
            return None;
        }
        let len = usize::from(u16::from_le_bytes([low, high]));
        let whole = len.checked_sub(base.to_bytes().len());
        Some((WriteData { base, payload }, whole))
    }

    pub(super) fn decode(r: &mut Reader<'a>, flags: u8) -> Result<Self, WireError> {
        plain(flags)?;
        Ok(WriteData {
            base: BaseRequest::decode(r)?,
            payload: r.rest(),
        })
    }
}

/// DATA: one sample from a data reader, requester or replier. `base` repeats the `READ_DATA` that
/// asked for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Data<'a> {
    /// The `READ_DATA` request and the reader.
    pub base: BaseRequest,
    /// The sample.
    pub payload: &'a [u8],
}

impl Encode for Data<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::Data
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.put(self.payload);
    }
}

impl<'a> Data<'a> {
    /// The same of a whole body; `None` if it is malformed.
    #[inline]
    pub(super) fn split(body: &'a [u8], flags: u8) -> Option<Self> {
        plain(flags).ok()?;
        let (base, payload) = BaseRequest::split(body)?;
        Some(Data { base, payload })
    }

    /// The beginning of a whole submessage, header included, if it is this one.
    pub(crate) fn of_beginning(bytes: &'a [u8]) -> Option<Self> {
        let (&[id, ..], rest) = bytes.split_first_chunk::<SUBHEADER>()?;
        let (base, payload) = BaseRequest::split(rest)?;
        (SubmessageId::from_number(id) == Ok(SubmessageId::Data)).then_some(Data { base, payload })
    }

    pub(super) fn decode(r: &mut Reader<'a>, flags: u8) -> Result<Self, WireError> {
        plain(flags)?;
        Ok(Data {
            base: BaseRequest::decode(r)?,
            payload: r.rest(),
        })
    }
}

/// Limits of an agent's deliveries for a `READ_DATA`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeliveryControl {
    /// Samples in all; [`DeliveryControl::UNLIMITED_SAMPLES`] for no end, 0 to cancel.
    pub max_samples: u16,
    /// Seconds until delivery ends; 0 for no end.
    pub max_elapsed_s: u16,
    /// Bytes per second; 0 for no limit.
    pub max_bytes_per_second: u16,
    /// Milliseconds between samples at least; 0 for none.
    pub min_pace_ms: u16,
}

impl DeliveryControl {
    /// `max_samples` without a limit.
    pub const UNLIMITED_SAMPLES: u16 = 0xffff;

    /// No limit of any kind.
    pub const UNLIMITED: DeliveryControl = DeliveryControl {
        max_samples: Self::UNLIMITED_SAMPLES,
        max_elapsed_s: 0,
        max_bytes_per_second: 0,
        min_pace_ms: 0,
    };

    /// Ends a delivery that was asked for before.
    pub const CANCEL: DeliveryControl = DeliveryControl {
        max_samples: 0,
        ..Self::UNLIMITED
    };
}

/// `READ_DATA`: asks for the samples of a reader; they come as DATA on the preferred stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadData<'a> {
    /// The reader.
    pub base: BaseRequest,
    /// Stream of the agent to deliver on.
    pub stream: StreamId,
    /// An SQL-like content filter.
    pub filter: Option<&'a str>,
    /// Limits; `None` asks for one sample.
    pub control: Option<DeliveryControl>,
}

impl Encode for ReadData<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::ReadData
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.u8(self.stream.0);
        w.u8(0); // FORMAT_DATA
        w.option(self.filter, Writer::string);
        w.option(self.control, |w, control| {
            w.u16(control.max_samples);
            w.u16(control.max_elapsed_s);
            w.u16(control.max_bytes_per_second);
            w.u16(control.min_pace_ms);
        });
    }
}

impl<'a> ReadData<'a> {
    /// The body of one without a filter.
    pub(crate) fn unfiltered(
        base: BaseRequest,
        stream: StreamId,
        control: DeliveryControl,
    ) -> [[u8; 4]; 4] {
        let pair = |low: u16, high: u16| (u32::from(high) << 16 | u32::from(low)).to_le_bytes();
        [
            base.to_bytes(),
            [stream.0, 0, 0, 1], // FORMAT_DATA; no filter, but limits
            pair(control.max_samples, control.max_elapsed_s),
            pair(control.max_bytes_per_second, control.min_pace_ms),
        ]
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        let base = BaseRequest::decode(r)?;
        let stream = StreamId(r.u8()?);
        plain(r.u8()?)?;
        let filter = r.option(Reader::string)?;
        let control = r.option(|r| {
            skip_length(r, 8)?;
            Ok(DeliveryControl {
                max_samples: r.u16()?,
                max_elapsed_s: r.u16()?,
                max_bytes_per_second: r.u16()?,
                min_pace_ms: r.u16()?,
            })
        })?;
        Ok(ReadData {
            base,
            stream,
            filter,
            control,
        })
    }
}

/// Steps over the length that the specification puts before an appendable structure of `size`
/// bytes (XCDR2's DHEADER), if it is there: eProsima's implementations leave it out, and the bytes
/// that follow tell the two apart.
fn skip_length(r: &mut Reader<'_>, size: u16) -> Result<(), WireError> {
    let mut ahead = *r;
    if ahead.u32()? == u32::from(size) && ahead.left() >= usize::from(size) {
        *r = ahead;
    }
    Ok(())
}

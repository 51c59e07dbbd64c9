//! Binary representations of data writers and data readers with their QoS.

use super::{ObjectId, Reader, WireError, Writer};

/// QoS flag: reliable, else best effort.
pub const QOS_RELIABLE: u16 = 1 << 0;
/// QoS flag: keep the last `depth` samples, else all.
pub const QOS_HISTORY_KEEP_LAST: u16 = 1 << 1;
/// QoS flag: late readers get the earlier samples of living writers.
pub const QOS_DURABILITY_TRANSIENT_LOCAL: u16 = 1 << 3;
/// QoS flag: as transient local, beyond the writer's life.
pub const QOS_DURABILITY_TRANSIENT: u16 = 1 << 4;
/// QoS flag: as transient, beyond the system's life.
pub const QOS_DURABILITY_PERSISTENT: u16 = 1 << 5;

/// The common QoS of writers and readers (`OBJK_Endpoint_QosBinary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct EndpointQos<'a> {
    /// `QOS_*` bits.
    pub flags: u16,
    /// Samples to keep.
    pub depth: Option<u16>,
    /// Longest time between samples, in milliseconds.
    pub deadline_ms: Option<u32>,
    /// Time a sample is valid, in milliseconds.
    pub lifespan_ms: Option<u32>,
    /// User data.
    pub user_data: Option<&'a [u8]>,
}

impl<'a> EndpointQos<'a> {
    fn write(&self, w: &mut Writer<'_>) {
        w.u16(self.flags);
        w.option(self.depth, Writer::u16);
        w.option(self.deadline_ms, Writer::u32);
        w.option(self.lifespan_ms, Writer::u32);
        w.option(self.user_data, Writer::bytes);
    }

    fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        Ok(EndpointQos {
            flags: r.u16()?,
            depth: r.option(Reader::u16)?,
            deadline_ms: r.option(Reader::u32)?,
            lifespan_ms: r.option(Reader::u32)?,
            user_data: r.option(Reader::bytes)?,
        })
    }
}

/// A data writer's QoS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct WriterQos<'a> {
    /// The common part.
    pub endpoint: EndpointQos<'a>,
    /// Ownership strength.
    pub ownership_strength: Option<u32>,
}

/// A data writer (`OBJK_DataWriter_Binary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataWriterBinary<'a> {
    /// Its topic.
    pub topic: ObjectId,
    /// Its QoS.
    pub qos: Option<WriterQos<'a>>,
}

impl<'a> DataWriterBinary<'a> {
    pub(super) fn write(&self, w: &mut Writer<'_>) {
        w.put(&self.topic.to_bytes());
        w.option(self.qos.as_ref(), |w, qos| {
            qos.endpoint.write(w);
            w.option(qos.ownership_strength, Writer::u32);
        });
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        Ok(DataWriterBinary {
            topic: ObjectId::from_bytes(r.array()?),
            qos: r.option(|r| {
                Ok(WriterQos {
                    endpoint: EndpointQos::decode(r)?,
                    ownership_strength: r.option(Reader::u32)?,
                })
            })?,
        })
    }
}

/// A data reader's QoS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ReaderQos<'a> {
    /// The common part.
    pub endpoint: EndpointQos<'a>,
    /// Shortest time between samples, in milliseconds.
    pub time_filter_ms: Option<u32>,
    /// An SQL-like content filter.
    pub content_filter: Option<&'a str>,
}

/// A data reader (`OBJK_DataReader_Binary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataReaderBinary<'a> {
    /// Its topic.
    pub topic: ObjectId,
    /// Its QoS.
    pub qos: Option<ReaderQos<'a>>,
}

impl<'a> DataReaderBinary<'a> {
    pub(super) fn write(&self, w: &mut Writer<'_>) {
        w.put(&self.topic.to_bytes());
        w.option(self.qos.as_ref(), |w, qos| {
            qos.endpoint.write(w);
            w.option(qos.time_filter_ms, Writer::u32);
            w.option(qos.content_filter, Writer::string);
        });
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        Ok(DataReaderBinary {
            topic: ObjectId::from_bytes(r.array()?),
            qos: r.option(|r| {
                Ok(ReaderQos {
                    endpoint: EndpointQos::decode(r)?,
                    time_filter_ms: r.option(Reader::u32)?,
                    content_filter: r.option(Reader::string)?,
                })
            })?,
        })
    }
}

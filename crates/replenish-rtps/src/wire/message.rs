//! Messages: a header and submessages (RTPS 2.5, 9.4.1 and 9.4.4).

use super::sets::put_sequence_number;
use super::submessage::{LITTLE_ENDIAN, id};
use super::{
    AckNack, Data, DataFrag, Gap, GuidPrefix, Heartbeat, HeartbeatFrag, NackFrag, Payload, Reader,
    Submessage, Timestamp, WireError, Writer,
};

const MAGIC: &[u8; 4] = b"RTPS";
/// The version of the protocol that this crate speaks.
pub const VERSION: [u8; 2] = [2, 3];
/// The vendor that this crate announces: none that the OMG has given a number.
pub const VENDOR: [u8; 2] = [0, 0];
/// Bytes of a message's header.
pub const HEADER: usize = 20;

/// A message that was received.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// The sender's protocol version.
    pub version: [u8; 2],
    /// The sender's vendor: 01.0f eProsima, 01.10 Eclipse Cyclone, 01.12 RustDDS.
    pub vendor: [u8; 2],
    /// The sender.
    pub prefix: GuidPrefix,
    body: &'a [u8],
}

impl<'a> Message<'a> {
    /// Reads the header.
    ///
    /// # Errors
    /// [`WireError::Truncated`], [`WireError::BadMagic`], [`WireError::BadVersion`].
    pub fn decode(datagram: &'a [u8]) -> Result<Self, WireError> {
        let mut r = Reader::new(datagram, true);
        if r.take(4)? != MAGIC {
            return Err(WireError::BadMagic);
        }
        let version: [u8; 2] = r.array()?;
        let [major, _] = version;
        if major != 2 {
            return Err(WireError::BadVersion(major));
        }
        Ok(Message {
            version,
            vendor: r.array()?,
            prefix: GuidPrefix(r.array()?),
            body: r.rest(),
        })
    }

    /// The submessages in order. An error is the last item: the specification has a receiver leave
    /// the rest of a damaged message.
    #[must_use]
    pub const fn submessages(&self) -> Submessages<'a> {
        Submessages {
            rest: self.body,
            ours: matches!(self.vendor, VENDOR),
        }
    }
}

/// Iterator over the submessages of a [`Message`].
#[derive(Clone, Debug)]
pub struct Submessages<'a> {
    rest: &'a [u8],
    /// The sender's vendor is ours, and vendor-specific kinds have our meaning.
    ours: bool,
}

impl<'a> Submessages<'a> {
    fn step(&mut self) -> Result<Submessage<'a>, WireError> {
        let mut r = Reader::new(self.rest, true);
        let (kind, flags) = (r.u8()?, r.u8()?);
        let mut r = Reader::new(r.rest(), flags & LITTLE_ENDIAN != 0);
        let len = match usize::from(r.u16()?) {
            // The submessage reaches to the end of the message, but for the two kinds that may be
            // empty.
            0 if kind != id::PAD && kind != id::INFO_TS => r.left(),
            len => len,
        };
        let body = r.take(len)?;
        self.rest = r.rest();
        Submessage::decode(kind, flags, body, self.ours)
    }
}

impl<'a> Iterator for Submessages<'a> {
    type Item = Result<Submessage<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let step = self.step();
        if step.is_err() {
            self.rest = &[];
        }
        Some(step)
    }
}

/// Builds a message. A submessage that does not fit leaves the message as it was.
#[derive(Debug)]
pub struct MessageWriter<'a> {
    w: Writer<'a>,
}

impl<'a> MessageWriter<'a> {
    /// A message from the participant `prefix`.
    ///
    /// # Errors
    /// [`WireError::NoRoom`] if `buf` is shorter than a header.
    pub fn new(buf: &'a mut [u8], prefix: GuidPrefix) -> Result<Self, WireError> {
        let mut w = Writer::new(buf);
        w.put(MAGIC);
        w.put(&VERSION);
        w.put(&VENDOR);
        w.put(&prefix.0);
        match w.roll_back(0) {
            Some(error) => Err(error),
            None => Ok(MessageWriter { w }),
        }
    }

    /// The message's length in bytes so far.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.w.len()
    }

    /// Whether there is no submessage yet.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.w.len() <= HEADER
    }

    /// Takes back all after the first `len` bytes, a length of earlier; never the header.
    pub fn truncate(&mut self, len: usize) {
        self.w.truncate(len.max(HEADER));
    }

    /// From now on the message grows to `bytes` at most, or to the end of its buffer.
    pub const fn limit(&mut self, bytes: usize) {
        self.w.limit(bytes);
    }

    /// Takes back every submessage.
    pub fn clear(&mut self) {
        self.truncate(HEADER);
    }

    /// The message.
    #[must_use]
    pub fn message(&self) -> &[u8] {
        self.w.written()
    }

    pub(super) fn submessage(
        &mut self,
        kind: u8,
        flags: u8,
        body: impl FnOnce(&mut Writer<'a>),
    ) -> Result<(), WireError> {
        let before = self.w.len();
        self.w.u8(kind);
        self.w.u8(flags | LITTLE_ENDIAN);
        self.w.put(&[0; 2]);
        let start = self.w.len();
        self.w.set_origin();
        body(&mut self.w);
        self.w.align(4);
        let len = self.w.len().saturating_sub(start);
        self.w.patch_u16(start.saturating_sub(2), len);
        self.w.roll_back(before).map_or(Ok(()), Err)
    }

    /// The submessages that follow are for `prefix`; zeros: for every participant.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn info_destination(&mut self, prefix: GuidPrefix) -> Result<(), WireError> {
        self.submessage(id::INFO_DST, 0, |w| w.put(&prefix.0))
    }

    /// The submessages that follow are from `prefix`.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn info_source(&mut self, prefix: GuidPrefix) -> Result<(), WireError> {
        self.submessage(id::INFO_SRC, 0, |w| {
            w.u32(0);
            w.put(&VERSION);
            w.put(&VENDOR);
            w.put(&prefix.0);
        })
    }

    /// The time of the samples that follow, or that they have none.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn info_timestamp(&mut self, time: Option<Timestamp>) -> Result<(), WireError> {
        match time {
            None => self.submessage(id::INFO_TS, 2, |_| {}),
            Some(time) => self.submessage(id::INFO_TS, 0, |w| time.encode(w)),
        }
    }

    /// An empty submessage.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn pad(&mut self) -> Result<(), WireError> {
        self.submessage(id::PAD, 0, |_| {})
    }

    /// Adds an ACKNACK: the samples that a reader has and lacks.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn acknack(&mut self, body: &AckNack) -> Result<(), WireError> {
        self.submessage(id::ACKNACK, u8::from(body.final_flag) << 1, |w| {
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            body.state.encode(w);
            w.u32(body.count);
        })
    }

    /// Adds a HEARTBEAT: the range of samples that a writer has.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn heartbeat(&mut self, body: &Heartbeat) -> Result<(), WireError> {
        let flags = (u8::from(body.final_flag) << 1) | (u8::from(body.liveliness) << 2);
        self.submessage(id::HEARTBEAT, flags, |w| {
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.first);
            put_sequence_number(w, body.last);
            w.u32(body.count);
        })
    }

    /// Samples that will not come.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn gap(&mut self, body: &Gap) -> Result<(), WireError> {
        self.submessage(id::GAP, 0, |w| {
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.start);
            body.list.encode(w);
        })
    }

    /// Fragments that a reader lacks.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn nack_frag(&mut self, body: &NackFrag) -> Result<(), WireError> {
        self.submessage(id::NACK_FRAG, 0, |w| {
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.sn);
            body.state.encode(w);
            w.u32(body.count);
        })
    }

    /// Fragments that a writer has sent.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn heartbeat_frag(&mut self, body: &HeartbeatFrag) -> Result<(), WireError> {
        self.submessage(id::HEARTBEAT_FRAG, 0, |w| {
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.sn);
            w.u32(body.last);
            w.u32(body.count);
        })
    }

    /// A sample. `inline_qos` is a finished list of parameters, or nothing; `body.inline_qos` is
    /// not looked at.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`].
    pub fn data(&mut self, body: &Data<'_>, inline_qos: &[u8]) -> Result<(), WireError> {
        let (flag, payload) = match body.payload {
            Payload::None => (0, [].as_slice()),
            Payload::Data(bytes) => (4, bytes),
            Payload::Key(bytes) => (8, bytes),
        };
        let flags = flag | (u8::from(!inline_qos.is_empty()) << 1);
        self.submessage(id::DATA, flags, |w| {
            w.u16(0);
            w.u16(16);
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.sn);
            w.put(inline_qos);
            w.put(payload);
        })
    }

    /// A part of a sample; `inline_qos` as in [`MessageWriter::data`].
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`].
    pub fn data_frag(&mut self, body: &DataFrag<'_>, inline_qos: &[u8]) -> Result<(), WireError> {
        let flags = (u8::from(!inline_qos.is_empty()) << 1) | (u8::from(body.key) << 2);
        self.submessage(id::DATA_FRAG, flags, |w| {
            w.u16(0);
            w.u16(28);
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.sn);
            w.u32(body.start);
            w.u16(body.count);
            w.u16(body.fragment_size);
            w.u32(body.sample_size);
            w.put(inline_qos);
            w.put(body.payload);
        })
    }
}

//! Messages: the header, and walking the submessages of a received message.

use super::header::SUBHEADER;
use super::{Body, Confirmed, Data, FLAG_LITTLE_ENDIAN, Header, SubmessageId, WireError, padding};

/// A received message: its header and the bytes of its submessages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// The header.
    pub header: Header,
    /// Everything after the header.
    pub body: &'a [u8],
}

impl<'a> Message<'a> {
    /// Splits a datagram (or frame) into header and body.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    #[inline]
    pub fn parse(datagram: &'a [u8]) -> Result<Self, WireError> {
        let (header, body) = Header::split(datagram)?;
        Ok(Message { header, body })
    }

    /// The submessages in order.
    #[must_use]
    pub const fn submessages(&self) -> Submessages<'a> {
        Submessages::new(self.body)
    }
}

/// A submessage as it stands in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submessage<'a> {
    /// Its id.
    pub id: SubmessageId,
    /// Its flag byte.
    pub flags: u8,
    /// Its body, not yet decoded.
    pub payload: &'a [u8],
}

impl<'a> Submessage<'a> {
    /// A sample that fragments gave and whose length is 0: it has all that follows, as it is longer
    /// than 65 535 bytes. That is what eProsima's client and agent do (their
    /// `TWEAK_XRCE_WRITE_LIMIT`); the specification has no way.
    pub(crate) fn unbounded(joined: &'a [u8]) -> Option<Self> {
        let (&[id, flags, 0, 0], payload) = joined.split_first_chunk()? else {
            return None;
        };
        let id = SubmessageId::from_number(id).ok()?;
        id.is_sample().then_some(Self { id, flags, payload })
    }

    /// Decodes the body.
    ///
    /// # Errors
    /// Every [`WireError`] but `NoRoom` and `TooLong`.
    pub fn body(&self) -> Result<Body<'a>, WireError> {
        Body::decode(self.id, self.flags, self.payload)
    }

    /// The byte order of its body.
    pub(crate) const fn little_endian(&self) -> bool {
        self.flags & FLAG_LITTLE_ENDIAN != 0
    }

    /// The confirmation that an ACKNACK carries besides the acknowledgement, if any.
    #[must_use]
    pub fn confirmed(&self) -> Option<Confirmed> {
        Confirmed::of(self.payload, self.little_endian())
    }

    /// Decodes the body of a sample, which most are.
    #[inline]
    pub(crate) fn data(&self) -> Option<Data<'a>> {
        if self.id != SubmessageId::Data {
            return None;
        }
        Data::split(self.payload, self.flags)
    }
}

/// Walks submessages; ends after the first one that is malformed.
#[derive(Clone, Debug)]
pub struct Submessages<'a> {
    bytes: &'a [u8],
    pos: usize,
}

impl<'a> Submessages<'a> {
    /// Walks `bytes`, which start at a submessage header.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Submessages { bytes, pos: 0 }
    }

    /// The id and flags of the next submessage, even if its body is cut.
    pub(crate) fn peek(&self) -> Option<(SubmessageId, u8)> {
        let [id, flags] = *self.bytes.get(self.pos..)?.first_chunk()?;
        Some((SubmessageId::from_number(id).ok()?, flags))
    }

    /// The next submessage; `None` at the end, and if it is malformed.
    #[inline]
    pub(crate) fn whole(&mut self) -> Option<Submessage<'a>> {
        let rest = self.bytes.get(self.pos..)?;
        let (&[id, flags, low, high], rest) = rest.split_first_chunk()?;
        let len = usize::from(u16::from_le_bytes([low, high]));
        let id = SubmessageId::from_number(id).ok()?;
        let payload = rest.get(..len)?;
        let end = self.pos.wrapping_add(SUBHEADER).wrapping_add(len);
        self.pos = end.wrapping_add(padding(end, 4));
        Some(Submessage { id, flags, payload })
    }

    /// Whether nothing is left: else the next submessage is malformed, if it is not whole.
    pub(crate) const fn is_done(&self) -> bool {
        self.pos >= self.bytes.len()
    }

    /// The error of the next submessage.
    fn error(&self) -> WireError {
        let rest = self.bytes.get(self.pos..).unwrap_or(&[]);
        let short = |needed, left| WireError::Truncated { needed, left };
        let Some((&[id, _, low, high], rest)) = rest.split_first_chunk() else {
            return short(SUBHEADER, rest.len());
        };
        let len = usize::from(u16::from_le_bytes([low, high]));
        match SubmessageId::from_number(id) {
            Ok(_) => short(len, rest.len()),
            Err(error) => error,
        }
    }
}

impl<'a> Iterator for Submessages<'a> {
    type Item = Result<Submessage<'a>, WireError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        if self.is_done() {
            return None;
        }
        if let Some(submessage) = self.whole() {
            return Some(Ok(submessage));
        }
        let error = self.error();
        self.pos = self.bytes.len();
        Some(Err(error))
    }
}

//! The four bytes before serialized data: its representation (RTPS 2.5, 10.2).

use super::{Parameters, Reader, WireError};

/// Representation of plain CDR, little endian, as the user's samples have it.
pub const CDR_LE: [u8; 4] = [0, 1, 0, 0];
/// Representation of a parameter list, little endian.
pub const PL_CDR_LE: [u8; 4] = [0, 3, 0, 0];

/// Serialized data with the representation that was announced before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encapsulated<'a> {
    /// The representation identifier: 0 and 1 CDR, 2 and 3 parameter list, 6 to 11 XCDR2; the odd
    /// ones are little endian.
    pub representation: u16,
    /// The data, without padding at the end.
    pub data: &'a [u8],
}

impl<'a> Encapsulated<'a> {
    /// Splits `payload`.
    ///
    /// # Errors
    /// [`WireError::Truncated`] if it is shorter than four bytes.
    pub fn decode(payload: &'a [u8]) -> Result<Self, WireError> {
        let mut r = Reader::new(payload, false);
        let (representation, options) = (r.u16()?, r.u16()?);
        let data = r.rest();
        let padding = usize::from(options & 3);
        let end = data.len().saturating_sub(padding);
        Ok(Encapsulated {
            representation,
            data: data.get(..end).unwrap_or(&[]),
        })
    }

    /// Whether numbers are little endian.
    #[must_use]
    pub const fn little_endian(&self) -> bool {
        self.representation & 1 == 1
    }

    /// A cursor over the data.
    #[must_use]
    pub const fn reader(&self) -> Reader<'a> {
        Reader::new(self.data, self.little_endian())
    }

    /// The parameters, if the data is a list of them.
    ///
    /// # Errors
    /// [`WireError::BadEncapsulation`].
    pub const fn parameters(&self) -> Result<Parameters<'a>, WireError> {
        match self.representation {
            2 | 3 => Ok(Parameters::new(self.reader())),
            other => Err(WireError::BadEncapsulation(other)),
        }
    }
}

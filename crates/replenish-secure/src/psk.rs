//! A pre-shared key.

use crate::error::SecureError;
use dimpl::PskResolver;
use std::fmt;
use std::ops::RangeInclusive;

/// Bytes of a key.
const BYTES: RangeInclusive<usize> = 16..=64;

/// A key that the agent's access list has for this client. It is never shown.
#[derive(Clone, PartialEq, Eq)]
pub struct Psk(Box<[u8]>);

impl Psk {
    /// A key of 16 to 64 bytes.
    ///
    /// # Errors
    /// [`SecureError::Setting`] for another length.
    pub fn new(key: &[u8]) -> Result<Self, SecureError> {
        let allowed = "from 16 to 64 bytes";
        let key = BYTES.contains(&key.len()).then(|| Self(key.into()));
        key.ok_or(SecureError::Setting {
            field: "psk",
            allowed,
        })
    }

    /// The same from hexadecimal digits, as in the access list.
    ///
    /// # Errors
    /// [`SecureError::Setting`] for another number of digits, or other characters.
    pub fn from_hex(digits: &str) -> Result<Self, SecureError> {
        let allowed = "32 to 128 hexadecimal digits, an even number";
        let key = hex(digits).filter(|key| BYTES.contains(&key.len()));
        let key = key.ok_or(SecureError::Setting {
            field: "psk",
            allowed,
        })?;
        Ok(Self(key.into()))
    }
}

impl fmt::Debug for Psk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Psk of {} bytes", self.0.len())
    }
}

impl PskResolver for Psk {
    fn resolve(&self, _identity: &[u8]) -> Option<Vec<u8>> {
        Some(self.0.to_vec())
    }
}

/// The bytes that pairs of hexadecimal digits stand for.
pub(crate) fn hex(text: &str) -> Option<Vec<u8>> {
    let pairs = text.as_bytes().chunks(2).map(|pair| {
        let pair = std::str::from_utf8(pair)
            .ok()
            .filter(|pair| pair.len() == 2)?;
        let digits = pair.bytes().all(|digit| digit.is_ascii_hexdigit());
        u8::from_str_radix(pair, 16).ok().filter(|_| digits)
    });
    pairs.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_16_to_64_bytes_and_are_not_shown() {
        let psk = Psk::from_hex(&"0f".repeat(16)).unwrap();
        assert_eq!(psk, Psk::new(&[15; 16]).unwrap());
        assert_eq!(format!("{psk:?}"), "Psk of 16 bytes");
        for digits in [
            "",
            "0f0",
            &"0f".repeat(15),
            &"0f".repeat(65),
            &"+f".repeat(16),
        ] {
            let error = Psk::from_hex(digits).unwrap_err().to_string();
            assert!(error.contains("psk must be 32 to 128"), "{digits}: {error}");
        }
        assert!(Psk::new(&[0; 15]).is_err() && Psk::new(&[0; 65]).is_err());
    }
}

//! A pre-shared key of a client.

use std::fmt;

/// A pre-shared key. It is never shown.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Psk(Box<[u8]>);

impl fmt::Debug for Psk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Psk of {} bytes", self.0.len())
    }
}

impl Psk {
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        Self(bytes.into())
    }

    /// The key itself.
    #[cfg(feature = "secure")]
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.0
    }
}

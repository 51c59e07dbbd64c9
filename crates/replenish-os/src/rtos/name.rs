//! The name of a thread as small kernels keep it.

use core::ffi::c_char;

/// The first 15 bytes of a name, and a zero.
#[derive(Clone, Copy)]
pub(crate) struct Name([u8; 16]);

impl Name {
    /// `None` if there is a zero in it.
    pub(crate) fn new(name: &str) -> Option<Self> {
        let mut kept = [0; 16];
        let (places, _) = kept.split_at_mut(15);
        let mut places = places.iter_mut();
        for byte in name.bytes() {
            if byte == 0 {
                return None;
            }
            if let Some(place) = places.next() {
                *place = byte;
            }
        }
        Some(Self(kept))
    }

    /// The name for C, valid as long as this value.
    pub(crate) const fn as_ptr(&self) -> *const c_char {
        self.0.as_ptr().cast()
    }
}

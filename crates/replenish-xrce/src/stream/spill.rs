//! A submessage that is larger than the free part of a ring: it waits here, encoded, and goes into
//! the ring fragment by fragment as acknowledgements make room.

use crate::wire::{Encode, WireError, Writer, encode_joined};

/// Room for one submessage.
#[derive(Debug)]
pub(super) struct Spill<S> {
    buf: S,
    /// Bytes of the submessage; 0 if there is none.
    pub(super) len: usize,
    /// Bytes that are in the ring already.
    pub(super) position: usize,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> Spill<S> {
    pub(super) const fn new(buf: S) -> Self {
        Spill {
            buf,
            len: 0,
            position: 0,
        }
    }

    /// The largest submessage it takes.
    pub(super) fn room(&self) -> usize {
        self.buf.as_ref().len()
    }

    pub(super) const fn is_busy(&self) -> bool {
        self.len > 0
    }

    pub(super) const fn clear(&mut self) {
        self.len = 0;
        self.position = 0;
    }

    /// Takes a submessage of `size` bytes.
    pub(super) fn fill<B: Encode + ?Sized>(
        &mut self,
        body: &B,
        size: usize,
    ) -> Result<(), WireError> {
        encode_joined(body, &mut Writer::new(self.buf.as_mut()))?;
        (self.len, self.position) = (size, 0);
        Ok(())
    }

    /// Copies the bytes from `position` on.
    pub(super) fn copy(&self, piece: &mut [u8], position: usize) {
        let end = position.wrapping_add(piece.len());
        if let Some(bytes) = self.buf.as_ref().get(position..end) {
            piece.copy_from_slice(bytes);
        }
    }

    /// The number of the submessage it holds.
    pub(super) fn id(&self) -> Option<u8> {
        self.buf.as_ref().first().copied().filter(|_| self.len > 0)
    }
}

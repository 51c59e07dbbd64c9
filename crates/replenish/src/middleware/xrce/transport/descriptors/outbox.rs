//! Bytes of one message that a byte stream has not taken yet.

use crate::platform::io::{self, ErrorKind};
use crate::platform::zeroed;
use alloc::boxed::Box;

#[derive(Debug)]
pub(super) struct Outbox {
    buf: Box<[u8]>,
    start: usize,
    end: usize,
}

impl Outbox {
    pub(super) fn new(len: usize) -> Self {
        Self {
            buf: zeroed(len),
            start: 0,
            end: 0,
        }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.start == self.end
    }

    pub(super) const fn clear(&mut self) {
        self.start = 0;
        self.end = 0;
    }

    /// Puts in what `write` writes; it gives the length, or `None` if there is no room.
    pub(super) fn put(&mut self, write: impl FnOnce(&mut [u8]) -> Option<usize>) -> Option<usize> {
        let len = write(&mut self.buf)?;
        (self.start, self.end) = (0, len);
        Some(len)
    }

    /// Writes as much as `write` takes.
    pub(super) fn drain(
        &mut self,
        mut write: impl FnMut(&[u8]) -> io::Result<usize>,
    ) -> io::Result<()> {
        while let Some(rest) = self.buf.get(self.start..self.end).filter(|r| !r.is_empty()) {
            match write(rest) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(len) => self.start += len,
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock => return Ok(()),
                    ErrorKind::Interrupted => {}
                    _ => return Err(error),
                },
            }
        }
        self.clear();
        Ok(())
    }
}

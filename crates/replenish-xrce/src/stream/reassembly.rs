//! Puts the fragments of a submessage together again, up to the storage's length.

/// Collects pieces that arrive in order.
#[derive(Debug)]
pub(super) struct Reassembly<R> {
    buf: R,
    len: usize,
    /// The current submessage is too long; its pieces are dropped up to the last one.
    skipping: bool,
}

/// The result of a piece.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Piece<'a> {
    /// More are to come.
    Partial,
    /// The fragment was the last one; here is the whole.
    Complete(&'a [u8]),
    /// The fragment made the whole too long; reported once per submessage, with the beginning of
    /// that.
    TooLong(&'a [u8]),
}

impl<R: AsRef<[u8]> + AsMut<[u8]>> Reassembly<R> {
    pub(super) const fn new(buf: R) -> Self {
        Reassembly {
            buf,
            len: 0,
            skipping: false,
        }
    }

    pub(super) const fn reset(&mut self) {
        self.len = 0;
        self.skipping = false;
    }

    /// Drops the submessage of an unreadable piece, up to its last piece.
    pub(super) const fn spoil(&mut self, last: bool) {
        self.len = 0;
        self.skipping = !last;
    }

    /// Bytes so far.
    pub(super) const fn collected(&self) -> usize {
        self.len
    }

    /// Goes back to the state before the last piece, when `collected` bytes were there, which made
    /// the whole [`Complete`](Piece::Complete).
    pub(super) const fn again(&mut self, collected: usize) {
        self.len = collected;
    }

    pub(super) fn append(&mut self, piece: &[u8], last: bool) -> Piece<'_> {
        let mut too_long = false;
        let end = self.len.wrapping_add(piece.len());
        if !self.skipping {
            match self.buf.as_mut().get_mut(self.len..end) {
                Some(room) => {
                    room.copy_from_slice(piece);
                    self.len = end;
                }
                None => {
                    self.skipping = true;
                    too_long = true;
                }
            }
        }
        let collected = self.len;
        if last {
            self.len = 0;
            if !core::mem::take(&mut self.skipping) {
                return Piece::Complete(self.buf.as_ref().get(..collected).unwrap_or(&[]));
            }
        }
        if too_long {
            Piece::TooLong(self.buf.as_ref().get(..collected).unwrap_or(&[]))
        } else {
            Piece::Partial
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_or_nothing() {
        let mut r = Reassembly::new([0; 6]);
        assert_eq!(r.append(b"abc", false), Piece::Partial);
        assert_eq!(r.append(b"def", true), Piece::Complete(b"abcdef"));
        assert_eq!(r.append(b"abcde", false), Piece::Partial);
        assert_eq!(r.append(b"fg", false), Piece::TooLong(b"abcde"));
        assert_eq!(r.append(b"h", false), Piece::Partial);
        assert_eq!(r.append(b"i", true), Piece::Partial);
        assert_eq!(r.append(b"jk", true), Piece::Complete(b"jk"));
        assert_eq!(r.append(b"abcdefg", true), Piece::TooLong(b""));
        assert_eq!(r.append(b"l", false), Piece::Partial);
        r.spoil(false);
        assert_eq!(r.append(b"a", false), Piece::Partial);
        assert_eq!(r.append(b"b", true), Piece::Partial);
        assert_eq!(r.append(b"c", false), Piece::Partial);
        r.spoil(true);
        assert_eq!(r.append(b"de", true), Piece::Complete(b"de"));
        r.append(b"f", false);
        r.reset();
        assert_eq!(r.append(b"m", true), Piece::Complete(b"m"));
    }
}

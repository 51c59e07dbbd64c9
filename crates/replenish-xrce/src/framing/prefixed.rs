//! TCP: each message follows its length, 16 bits, little endian.

/// The length that goes before a message of `len` bytes, if it can have one.
#[must_use]
pub fn prefix(len: usize) -> Option<[u8; 2]> {
    u16::try_from(len).ok().map(u16::to_le_bytes)
}

/// Puts messages together from pieces of a stream; the longest is as long as `B`.
///
/// There is no way to find the next message after one that is too long to be kept, but to skip as
/// many bytes as were announced; that is what happens, and [`skipped`](Self::skipped) counts it.
#[derive(Debug)]
pub struct Prefixed<B> {
    buf: B,
    head: [u8; 2],
    head_len: usize,
    /// Bytes of the message that are here.
    len: usize,
    skipped: u64,
}

impl<B: AsRef<[u8]> + AsMut<[u8]>> Prefixed<B> {
    /// A stream at its beginning.
    pub const fn new(buf: B) -> Self {
        Self {
            buf,
            head: [0; 2],
            head_len: 0,
            len: 0,
            skipped: 0,
        }
    }

    /// Forgets a partial message, for a new connection.
    pub const fn reset(&mut self) {
        self.head_len = 0;
        self.len = 0;
    }

    /// Messages that were longer than the buffer.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Takes in a piece of the stream; calls `deliver` with each message that is whole now.
    pub fn push(&mut self, mut bytes: &[u8], mut deliver: impl FnMut(&[u8])) {
        while let Some((&first, rest)) = bytes.split_first() {
            if let Some(slot) = self.head.get_mut(self.head_len) {
                *slot = first;
                self.head_len = self.head_len.saturating_add(1);
                bytes = rest;
                if self.head_len < self.head.len() {
                    continue;
                }
            }
            let whole = usize::from(u16::from_le_bytes(self.head));
            let take = whole.saturating_sub(self.len).min(bytes.len());
            let (piece, rest) = bytes.split_at_checked(take).unwrap_or((bytes, &[]));
            let end = self.len.saturating_add(take);
            if let Some(room) = self.buf.as_mut().get_mut(self.len..end) {
                room.copy_from_slice(piece);
            }
            (self.len, bytes) = (end, rest);
            if end == whole {
                match self.buf.as_ref().get(..whole) {
                    Some(message) if whole > 0 => deliver(message),
                    Some(_nothing) => {}
                    None => self.skipped = self.skipped.saturating_add(1),
                }
                (self.head_len, self.len) = (0, 0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn messages_come_whole_however_the_stream_is_cut() {
        let mut stream = Vec::new();
        let messages = [vec![1, 2, 3], vec![], vec![7; 300], vec![9; 9], vec![4]];
        for message in &messages {
            stream.extend(prefix(message.len()).unwrap());
            stream.extend(message);
        }
        let kept: Vec<Vec<u8>> = messages
            .iter()
            .filter(|m| (1..=100).contains(&m.len()))
            .cloned()
            .collect();
        for size in 1..stream.len() {
            let mut decoder = Prefixed::new([0; 100]);
            let mut got: Vec<Vec<u8>> = Vec::new();
            for piece in stream.chunks(size) {
                decoder.push(piece, |message| got.push(message.to_vec()));
            }
            assert_eq!(got, kept, "pieces of {size}");
            assert_eq!(decoder.skipped(), 1);
        }
        assert_eq!(prefix(65536), None);
    }
}

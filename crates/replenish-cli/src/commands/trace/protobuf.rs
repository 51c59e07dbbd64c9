//! Messages in the encoding of Protocol Buffers: as much of it as a trace needs.
//!
//! The crates that know Perfetto's messages bring 10 to 63 others; these lines bring none.

/// A message under construction.
#[derive(Debug, Default)]
pub(super) struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        loop {
            let low = value.to_le_bytes()[0] & 0x7f;
            value >>= 7;
            if value == 0 {
                return self.0.push(low);
            }
            self.0.push(low | 0x80);
        }
    }

    fn tag(&mut self, field: u32, kind: u64) {
        self.varint(u64::from(field) << 3 | kind);
    }

    /// A number.
    pub(super) fn number(mut self, field: u32, value: u64) -> Self {
        self.tag(field, 0);
        self.varint(value);
        self
    }

    /// A number of 64 bits.
    pub(super) fn fixed(mut self, field: u32, value: u64) -> Self {
        self.tag(field, 1);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Bytes of known length: a text, or a message.
    fn bytes(mut self, field: u32, bytes: &[u8]) -> Self {
        self.tag(field, 2);
        self.varint(bytes.len() as u64);
        self.0.extend(bytes);
        self
    }

    /// A text.
    pub(super) fn text(self, field: u32, text: &str) -> Self {
        self.bytes(field, text.as_bytes())
    }

    /// A message in this one.
    pub(super) fn message(self, field: u32, message: &Self) -> Self {
        self.bytes(field, &message.0)
    }

    /// The encoded bytes.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of the encoding's documentation.
    #[test]
    fn the_documented_examples() {
        let encoded = Message::default().number(1, 150).into_bytes();
        assert_eq!(encoded, [0x08, 0x96, 0x01]);
        let encoded = Message::default().text(2, "testing").into_bytes();
        assert_eq!(encoded, *b"\x12\x07testing");
        let inner = Message::default().number(1, 150);
        let encoded = Message::default().message(3, &inner).into_bytes();
        assert_eq!(encoded, [0x1a, 0x03, 0x08, 0x96, 0x01]);
    }
}

//! Decrypted messages of one reading, on their way out of the transport's lock.

/// Messages one behind the other, in memory that is used again.
#[derive(Debug, Default)]
pub(crate) struct Messages {
    bytes: Vec<u8>,
    ends: Vec<usize>,
}

impl Messages {
    pub(crate) fn with_capacity(bytes: usize) -> Self {
        Self {
            bytes: Vec::with_capacity(bytes),
            ends: Vec::with_capacity(64),
        }
    }

    pub(crate) fn push(&mut self, message: &[u8]) {
        self.bytes.extend_from_slice(message);
        self.ends.push(self.bytes.len());
    }

    /// Hands over all messages and forgets them; whether there were any.
    pub(crate) fn deliver(&mut self, deliver: &mut dyn FnMut(&[u8])) -> bool {
        let mut start = 0;
        for end in &self.ends {
            deliver(self.bytes.get(start..*end).unwrap_or_default());
            start = *end;
        }
        let any = !self.ends.is_empty();
        self.bytes.clear();
        self.ends.clear();
        any
    }
}

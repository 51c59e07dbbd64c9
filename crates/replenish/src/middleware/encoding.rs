//! Encoding and decoding of samples, with errors that name the field, its length, the room there is
//! and the call that makes more. `encoding_disabled.rs` takes this file's place without feature
//! `texts`.

use super::PublishError;
pub(crate) use replenish_msg::decode_with_path as decode;
use replenish_msg::{CdrError, Message, Structure, field_path};

/// The structure of a message, and the call that makes its buffer longer.
#[derive(Clone, Copy)]
pub(crate) struct Encoding {
    fields: &'static Structure,
    remedy: &'static str,
}

impl Encoding {
    /// Messages of type `M`, into a buffer that `remedy` makes longer.
    pub(crate) const fn of<M: Message>(remedy: &'static str) -> Self {
        let fields = M::STRUCTURE;
        Self { fields, remedy }
    }

    /// Encoding into `buffer` has failed.
    #[cold]
    pub(crate) fn failed(self, error: CdrError, buffer: &[u8]) -> PublishError {
        let CdrError::EndOfBuffer { at, needed, .. } = error else {
            return PublishError::Encode(error);
        };
        let written = buffer.get(..at).unwrap_or_default();
        PublishError::TooLong {
            field: field_path::unwritten(self.fields, written),
            size: at.saturating_add(needed),
            limit: buffer.len(),
            remedy: self.remedy,
        }
    }
}

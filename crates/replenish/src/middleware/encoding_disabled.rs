//! In the place of `encoding` without feature `texts`: errors name no field.

use super::PublishError;
pub(crate) use replenish_msg::decode_whole as decode;
use replenish_msg::{CdrError, Message};

/// Nothing is known of a message that cannot be encoded.
#[derive(Clone, Copy)]
pub(crate) struct Encoding;

impl Encoding {
    #[expect(
        clippy::extra_unused_type_parameters,
        reason = "the signature of what it stands in for"
    )]
    pub(crate) const fn of<M: Message>(_: &'static str) -> Self {
        Self
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    #[inline(always)]
    pub(crate) const fn failed(self, error: CdrError, _: &[u8]) -> PublishError {
        PublishError::Encode(error)
    }
}

//! What is said of a message that cannot be encoded into its buffer: which field, how long it is, how
//! much there is room for, and what makes more. Builds without feature `texts` say that it is so.

use super::PublishError;
use replenish_msg::{CdrError, Message};
#[cfg(feature = "texts")]
use replenish_msg::{Structure, located};

/// What makes room in a publisher's buffer.
pub(crate) const PUBLISHER: &str = "Node::publisher_sized";
/// In a client's or a server's.
pub(crate) const SERVICE: &str = "Topic::max_size";
/// In those of an action.
pub(crate) const ACTION: &str = "ActionOptions::max_size";
/// In an output barrier.
pub(crate) const BARRIER: &str = "WorkerBuilder::output_barrier";

/// What is known of a message before it is encoded.
#[derive(Clone, Copy)]
pub(crate) struct Encoding {
    #[cfg(feature = "texts")]
    fields: &'static Structure,
    #[cfg(feature = "texts")]
    remedy: &'static str,
}

#[cfg(feature = "texts")]
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
            field: located::unwritten(self.fields, written),
            size: at.saturating_add(needed),
            limit: buffer.len(),
            remedy: self.remedy,
        }
    }
}

#[cfg(not(feature = "texts"))]
impl Encoding {
    #[expect(
        clippy::extra_unused_type_parameters,
        reason = "the signature of what it stands in for"
    )]
    pub(crate) const fn of<M: Message>(_: &'static str) -> Self {
        Self {}
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    #[inline(always)]
    pub(crate) const fn failed(self, error: CdrError, _: &[u8]) -> PublishError {
        PublishError::Encode(error)
    }
}

impl PublishError {
    /// It is something else that makes a longer buffer.
    pub(crate) fn remedied_by(self, remedy: &'static str) -> Self {
        match self {
            #[cfg(feature = "texts")]
            Self::TooLong {
                field, size, limit, ..
            } => Self::TooLong {
                field,
                size,
                limit,
                remedy,
            },
            other => {
                let _ = remedy;
                other
            }
        }
    }
}

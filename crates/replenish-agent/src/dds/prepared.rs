//! Samples as they leave for DDS, and requests from DDS until their replies.

use super::endpoint::RequestId;
use replenish_rtps::wire::{Guid, GuidPrefix, SampleIdentity};
use std::time::Instant;

/// The form of a request and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Enhanced,
    Cyclone,
}

/// A request from DDS that waits for its reply.
pub(super) struct Asked {
    pub(super) form: Form,
    /// The identity that the reply names.
    pub(super) to: SampleIdentity,
    pub(super) from: Guid,
    /// The time until which its reply waits for a reader of the program that asked.
    pub(super) until: Instant,
}

/// A sample as it goes to DDS.
pub(super) struct Prepared {
    pub(super) payload: Vec<u8>,
    pub(super) related: Option<SampleIdentity>,
    /// The participant whose readers alone get it.
    pub(super) only: Option<GuidPrefix>,
    /// The program's name for the request, and its form.
    pub(super) call: Option<(RequestId, Form, i64)>,
}

impl Prepared {
    pub(super) fn plain(payload: Vec<u8>) -> Self {
        Self {
            payload,
            related: None,
            only: None,
            call: None,
        }
    }
}

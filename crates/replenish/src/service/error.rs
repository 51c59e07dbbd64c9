//! Reasons why there is no reply, or not even a request.

use crate::middleware::PublishError;
use core::fmt;
use replenish_msg::DecodeError;

/// Reason why there is no reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoReply {
    /// No reply has come in time. One that comes later is counted as discarded.
    TimedOut,
    /// The reply cannot be decoded. It is counted and reported to the error hook as well.
    Undecodable(DecodeError),
}

impl fmt::Display for NoReply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TimedOut => f.write_str("no reply in time"),
            Self::Undecodable(error) => write!(f, "the reply cannot be decoded: {error}"),
        }
    }
}

impl core::error::Error for NoReply {}

/// A request was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CallError {
    /// The most requests wait for their replies already.
    TooMany {
        /// The most requests that may wait.
        limit: usize,
    },
    /// The client has no callback for replies:
    /// [`WorkerBuilder::replies`](crate::WorkerBuilder::replies).
    NoCallback,
    /// The client's callback for replies will not run any more: its executor has ended or was
    /// dropped, its handle was removed, or it has panicked. A client belongs to one callback for
    /// good; another executor needs another client.
    Gone,
    /// The middleware did not send it.
    Send(PublishError),
    /// The request was sent, and awaited in vain:
    /// [`Client::call_async`](crate::Client::call_async).
    NoReply(NoReply),
}

impl fmt::Display for CallError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooMany { limit } => {
                write!(f, "too many requests without reply: the limit is {limit}")
            }
            Self::NoCallback => f.write_str("the client has no callback for replies"),
            Self::Gone => f.write_str(
                "the client's callback for replies is gone: its executor has ended, it was removed, or it panicked",
            ),
            Self::Send(e) => e.fmt(f),
            Self::NoReply(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for CallError {}

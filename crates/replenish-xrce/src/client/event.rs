//! The events and errors of a session.

use core::fmt;

use crate::stream::PushError;
use crate::wire::{
    Info, Notice, ObjectId, RequestId, SampleIdentity, Status, StreamId, TimestampReply,
};

/// Something that happened in a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// The session exists and everything in the journal was answered.
    Up,
    /// The agent is lost; the session tries to reach it again by itself.
    Down,
    /// The agent refuses the session; the session tries again by itself.
    Refused(Status),
    /// The answer to a CREATE or DELETE, or the agent's complaint about another request.
    Status {
        /// The request.
        request: RequestId,
        /// Its object.
        object: ObjectId,
        /// Its outcome.
        status: Status,
    },
    /// A sample.
    Data {
        /// The data reader.
        reader: ObjectId,
        /// The `READ_DATA` that asked for it.
        request: RequestId,
        /// The sample: CDR without encapsulation header.
        payload: &'a [u8],
    },
    /// A sample has come in fragments, and is longer than what the session can put together.
    TooLong {
        /// The data reader.
        reader: ObjectId,
        /// The `READ_DATA` that asked for it.
        request: RequestId,
    },
    /// A request to a replier.
    Request {
        /// The replier.
        replier: ObjectId,
        /// Identity to pass to [`Session::reply`](super::Session::reply).
        identity: SampleIdentity,
        /// The request.
        payload: &'a [u8],
    },
    /// A reply to a requester.
    Reply {
        /// The requester.
        requester: ObjectId,
        /// The number that [`Session::request`](super::Session::request) returned.
        request: RequestId,
        /// The reply.
        payload: &'a [u8],
    },
    /// A notice of the agent about an object.
    Notice {
        /// The object.
        object: ObjectId,
        /// The notice.
        notice: Notice,
    },
    /// The answer to [`Session::request_info`](super::Session::request_info).
    Info(Info),
    /// The answer to [`Session::request_time`](super::Session::request_time).
    Time(TimestampReply),
    /// The session was closed.
    Closed,
}

/// Reason why a sample was not written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WriteError {
    /// There is no session at the moment.
    Down,
    /// The stream has no room until more is sent or acknowledged.
    WouldBlock,
    /// The sample can never be sent on this stream.
    TooLarge {
        /// Bytes of the sample.
        size: usize,
        /// The most the stream takes.
        limit: usize,
    },
    /// The session has no such output stream.
    UnknownStream(StreamId),
}

impl WriteError {
    /// Bytes of a `WRITE_DATA` besides its payload.
    pub(super) const OVERHEAD: usize = 8;

    pub(super) fn from_push(error: PushError, size: usize) -> Self {
        match error {
            PushError::WouldBlock => WriteError::WouldBlock,
            PushError::TooLarge { limit, .. } => WriteError::TooLarge {
                size,
                limit: limit.saturating_sub(Self::OVERHEAD),
            },
            PushError::Wire(_) => {
                let limit = usize::from(u16::MAX).saturating_sub(Self::OVERHEAD);
                WriteError::TooLarge { size, limit }
            }
        }
    }
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            WriteError::Down => f.write_str("no session with the agent at the moment"),
            WriteError::WouldBlock => f.write_str("the output stream is full"),
            WriteError::TooLarge { size, limit } => {
                write!(
                    f,
                    "a sample of {size} bytes; the stream takes at most {limit}"
                )
            }
            WriteError::UnknownStream(id) => write!(f, "no output stream {:#04x}", id.0),
        }
    }
}

impl core::error::Error for WriteError {}

/// Reason why a request was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RequestError {
    /// The journal has no entry left, or no room for this one's names.
    JournalFull,
    /// The object's id or kind does not fit the request.
    WrongObject(ObjectId),
    /// The description cannot be sent on this session's streams.
    Stream(PushError),
    /// There is no session at the moment.
    Down,
    /// This build cannot do that: it lacks the feature `queries` or `services`.
    Unsupported,
}

impl fmt::Display for RequestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RequestError::JournalFull => f.write_str("the session's journal of objects is full"),
            RequestError::WrongObject(object) => write!(f, "wrong object {object:?}"),
            RequestError::Stream(error) => error.fmt(f),
            RequestError::Unsupported => {
                f.write_str("built without the feature `queries` or `services`")
            }
            RequestError::Down => f.write_str("no session with the agent at the moment"),
        }
    }
}

impl core::error::Error for RequestError {}

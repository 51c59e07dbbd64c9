//! Reasons why the agent refuses or drops something, in words.

use super::handshake::HandshakeError;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{ObjectId, Status};
use std::fmt;

/// Why, with the limit that was met. Its text says both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// A datagram that is not a DDS-XRCE message, or is broken from some byte on.
    Malformed {
        /// Bytes of the message.
        bytes: usize,
    },
    /// A message of a session that was not opened at its address.
    NoSession {
        /// The session id.
        session: u8,
    },
    /// A message with the key of another client.
    WrongKey,
    /// A submessage, or a stream, that this agent does not know.
    Unsupported,
    /// More datagrams a second than a client may send.
    Rate {
        /// `limits.datagrams_per_second`.
        limit: u32,
    },
    /// More log-ins and pings a second than all without a session, or this one of them, may send.
    Unauthenticated {
        /// `limits.unauthenticated_per_second`.
        limit: u32,
    },
    /// A log-in that makes no sense.
    LogIn {
        /// The part of it that makes no sense.
        field: &'static str,
        /// The answer.
        status: Status,
    },
    /// A log-in while there are as many clients as there may be.
    Clients {
        /// `limits.clients`.
        limit: usize,
    },
    /// A message on one stream more than a client may have, or may have memory for.
    Streams {
        /// `limits.streams`.
        limit: usize,
    },
    /// A request that was answered with an error.
    Request {
        /// The object of the request.
        object: ObjectId,
        /// The answer.
        status: Status,
        /// The limit that was met, by name and value, if it was one.
        limit: Option<(&'static str, usize)>,
    },
    /// A sample that is too large.
    Sample {
        /// Its bytes; unknown if it came in fragments and did not say.
        bytes: Option<usize>,
        /// `limits.sample`.
        limit: usize,
    },
    /// A sample for a client that keeps as many bytes as it may.
    Memory {
        /// `limits.client_bytes`.
        limit: usize,
    },
    /// A TCP connection while there are as many as there may be, or that failed.
    Connection {
        /// The most TCP connections.
        limit: usize,
    },
    /// Frames that were damaged, cut or too long.
    Frames {
        /// Number of frames.
        count: u64,
    },
    /// The client was silent for too long; its session ended.
    Silent {
        /// `limits.silence`, in nanoseconds.
        limit: Nanos,
    },
    /// The client's connection or line has gone; its session ended.
    Disconnected,
    /// Nothing has come in the session since its log-in; it ended for another client's log-in.
    Unused {
        /// Time in nanoseconds that a session may stay so while there are as many clients as there
        /// may be.
        limit: Nanos,
    },
    /// The client's address, or host, had more than half of all places; its session ended for
    /// another client's log-in.
    Crowded {
        /// `limits.clients`.
        limit: usize,
    },
    /// A TCP connection without a log-in for too long; it was closed.
    NoLogIn {
        /// The longest time without a log-in, in nanoseconds.
        limit: Nanos,
    },
    /// An answer to an address that has not shown that it receives: more bytes than it may cause.
    Reflection {
        /// `limits.reflection`.
        limit: u32,
    },
    /// A log-in with the key of a session whose client answers at another address.
    TakeoverRefused,
    /// A client that the access list does not allow.
    NotListed {
        /// The part that is not in the list: its key, its address, the topics that it uses.
        field: &'static str,
        /// The client had a session, which a new list has ended.
        session: bool,
    },
    /// A handshake of DTLS or TLS that failed.
    Handshake(HandshakeError),
    /// A handshake while there are as many as there may be, or more of them a second than all, or
    /// one host, may begin.
    Handshakes {
        /// The limit that was met: at the same time, of one host, or a second.
        limit: usize,
    },
    /// A writer, reader, requester or replier of a topic that the access list does not allow.
    Topic {
        /// The object of the request.
        object: ObjectId,
    },
    /// A client logged in at another address, and its session at the old one did not answer.
    Takeover {
        /// The line is about the old address; otherwise about the new one.
        from: bool,
    },
}

/// Kinds of reasons.
pub(super) const KINDS: usize = 26;

impl Reason {
    /// The kind of reason, as a word.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        self.number_and_kind().1
    }

    /// The answer to a request or log-in that was refused with one.
    pub(super) fn status(&self) -> Option<Status> {
        match self {
            Self::LogIn { status, .. } | Self::Request { status, .. } => Some(*status),
            Self::Clients { .. } => Some(Status::RESOURCES),
            Self::Topic { .. } | Self::TakeoverRefused | Self::NotListed { session: false, .. } => {
                Some(Status::DENIED)
            }
            _ => None,
        }
    }

    /// The object of a request.
    pub(super) fn object(&self) -> Option<ObjectId> {
        match self {
            Self::Request { object, .. } | Self::Topic { object } => Some(*object),
            _ => None,
        }
    }

    pub(super) const fn number_and_kind(&self) -> (usize, &'static str) {
        match self {
            Self::Malformed { .. } => (0, "malformed"),
            Self::NoSession { .. } => (1, "no_session"),
            Self::WrongKey => (2, "wrong_key"),
            Self::Unsupported => (3, "unsupported"),
            Self::Rate { .. } => (4, "rate"),
            Self::Unauthenticated { .. } => (5, "strangers"),
            Self::LogIn { .. } => (6, "log_in"),
            Self::Clients { .. } => (7, "clients"),
            Self::Streams { .. } => (8, "streams"),
            Self::Request { .. } => (9, "request"),
            Self::Sample { .. } => (10, "sample"),
            Self::Memory { .. } => (11, "memory"),
            Self::Connection { .. } => (12, "connection"),
            Self::Frames { .. } => (13, "frames"),
            Self::Silent { .. } => (14, "silent"),
            Self::Disconnected => (15, "disconnected"),
            Self::Unused { .. } => (16, "unused"),
            Self::Crowded { .. } => (17, "crowded"),
            Self::NoLogIn { .. } => (18, "no_log_in"),
            Self::Reflection { .. } => (19, "reflection"),
            Self::TakeoverRefused => (20, "takeover_refused"),
            Self::Takeover { .. } => (21, "takeover"),
            Self::NotListed { .. } => (22, "not_listed"),
            Self::Topic { .. } => (23, "topic"),
            Self::Handshake(_) => (24, "handshake"),
            Self::Handshakes { .. } => (25, "handshakes"),
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed { bytes } => {
                write!(f, "dropped {bytes} bytes that are no DDS-XRCE message")
            }
            Self::NoSession { session } => {
                write!(
                    f,
                    "dropped a message of session {session:#04x}, which nobody has opened"
                )
            }
            Self::WrongKey => f.write_str("dropped a message with another client's key"),
            Self::Unsupported => f.write_str("ignored a submessage that is unknown or unsupported"),
            Self::Rate { limit } => write!(
                f,
                "dropped a datagram: more than limits.datagrams_per_second = {limit}"
            ),
            Self::Unauthenticated { limit } => write!(
                f,
                "dropped a log-in or ping: more than its share of limits.unauthenticated_per_second = {limit}"
            ),
            Self::LogIn { field, status } => {
                write!(f, "refused a log-in with {status}: {field}")
            }
            Self::Clients { limit } => {
                write!(f, "refused a log-in: limits.clients = {limit} are there")
            }
            Self::Streams { limit } => write!(
                f,
                "dropped a message of a new stream: limits.streams = {limit}, or limits.client_bytes"
            ),
            Self::Request {
                object,
                status,
                limit,
            } => {
                let id = super::hex::hex(*object);
                write!(f, "refused a request about object {id} with {status}")?;
                match limit {
                    Some((field, limit)) => write!(f, ": {field} = {limit}"),
                    None => Ok(()),
                }
            }
            Self::Sample { bytes, limit } => {
                f.write_str("dropped a sample")?;
                if let Some(bytes) = bytes {
                    write!(f, " of {bytes} bytes")?;
                }
                write!(f, ": limits.sample = {limit}")
            }
            Self::Memory { limit } => {
                write!(
                    f,
                    "dropped a sample for this client: it keeps limits.client_bytes = {limit} already"
                )
            }
            Self::Connection { limit } => {
                write!(f, "closed a connection: {limit} are the most, or it failed")
            }
            Self::Frames { count } => {
                write!(
                    f,
                    "dropped {count} frames that were damaged, cut or too long"
                )
            }
            Self::Silent { limit } => {
                let seconds = *limit as f64 / 1e9;
                write!(
                    f,
                    "ended a session: silent for limits.silence = {seconds} s"
                )
            }
            Self::Disconnected => f.write_str("ended a session: its connection or line has gone"),
            Self::Unused { limit } => {
                let seconds = *limit as f64 / 1e9;
                write!(
                    f,
                    "ended a session for another: nothing came for {seconds} s after its log-in"
                )
            }
            Self::Crowded { limit } => write!(
                f,
                "ended a session for another: its address or host had more than half of limits.clients = {limit}"
            ),
            Self::NoLogIn { limit } => {
                let seconds = *limit as f64 / 1e9;
                write!(f, "closed a connection: no log-in for {seconds} s")
            }
            Self::Reflection { limit } => write!(
                f,
                "kept back an answer: more than limits.reflection = {limit} times the bytes of an address that has not shown that it receives"
            ),
            Self::TakeoverRefused => f.write_str(
                "refused a log-in: the client with this key answers at another address",
            ),
            Self::NotListed { field, session } => {
                let refused = if *session {
                    "ended a session"
                } else {
                    "refused a log-in"
                };
                write!(f, "{refused}: the access list does not have its {field}")
            }
            Self::Handshake(error) => write!(f, "refused a handshake: {error}"),
            Self::Handshakes { limit } => {
                write!(f, "refused a handshake: {limit} are the most")
            }
            Self::Topic { object } => {
                let id = super::hex::hex(*object);
                write!(f, "refused object {id}: the access list does not have its topic")
            }
            Self::Takeover { from: true } => f.write_str(
                "ended a session: its client logged in at another address, and this one did not answer",
            ),
            Self::Takeover { from: false } => f.write_str(
                "took over the session of this key from an address that did not answer",
            ),
        }
    }
}

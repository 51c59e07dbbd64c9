//! The agent's rejections and their reasons, in a bounded log that another thread reads.
//!
//! ```text
//!   agent ──► one ring for each kind, the last 32 of it ──► the thread that drains it
//!                └─ full or being drained: only counted
//! ```
//!
//! One ring for each kind, so that a flood of one does not push out the others. The agent never
//! waits: while another thread drains, it only counts.

use replenish_xrce::Nanos;
use replenish_xrce::wire::{ClientKey, ObjectId, Status};
use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Rejections of one kind that are kept until a thread drains them.
const KEPT: usize = 32;

/// Something that was refused or dropped, or an end that a client did not ask for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rejection {
    /// When, in nanoseconds on the agent's monotonic clock.
    pub at: Nanos,
    /// Where it came from, as in [`ClientSnapshot::peer`](crate::ClientSnapshot::peer).
    pub peer: String,
    /// The client's key as eight hexadecimal digits, if it is known.
    pub key: Option<String>,
    /// The reason.
    pub reason: Reason,
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(key) = &self.key {
            write!(f, "client {key} at ")?;
        }
        write!(f, "{}: {}", self.peer, self.reason)
    }
}

/// Why, with the limit that was met. Its text says both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// Not a DDS-XRCE message, or broken from some byte on.
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
    /// More datagrams a second than all without a session may send.
    Unauthenticated {
        /// `limits.unauthenticated_per_second`.
        limit: u32,
    },
    /// A log-in that makes no sense.
    LogIn {
        /// Which part of it.
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
        /// Its bytes.
        bytes: usize,
        /// `limits.sample`.
        limit: usize,
    },
    /// A sample while the bytes of all samples have reached their limit.
    Memory {
        /// `limits.queued_bytes`.
        limit: usize,
    },
    /// A TCP connection while there are as many as there may be, or that failed.
    Connection {
        /// How many there may be.
        limit: usize,
    },
    /// Frames that were damaged, cut or too long.
    Frames {
        /// How many.
        count: u64,
    },
    /// The client was silent for too long; its session ended.
    Silent {
        /// `limits.silence`, in nanoseconds.
        limit: Nanos,
    },
    /// The client's connection or line has gone; its session ended.
    Disconnected,
}

/// Kinds of reasons.
const KINDS: usize = 16;

impl Reason {
    /// The kind of reason, as a word.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        self.number_and_kind().1
    }

    const fn number_and_kind(&self) -> (usize, &'static str) {
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
                "dropped a datagram without session: more than limits.unauthenticated_per_second = {limit}"
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
                let id = super::snapshot::hex(*object);
                write!(f, "refused a request about object {id} with {status}")?;
                match limit {
                    Some((field, limit)) => write!(f, ": {field} = {limit}"),
                    None => Ok(()),
                }
            }
            Self::Sample { bytes, limit } => {
                write!(
                    f,
                    "dropped a sample of {bytes} bytes: limits.sample = {limit}"
                )
            }
            Self::Memory { limit } => {
                write!(
                    f,
                    "dropped a sample: limits.queued_bytes = {limit} are kept already"
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
        }
    }
}

/// The rejections since the last call.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    /// The last of each kind, all in the order in which they happened.
    pub list: Vec<Rejection>,
    /// How many more there were, by [kind](Reason::kind); only kinds with some.
    pub omitted: Vec<(&'static str, u64)>,
}

/// The log. `P` is the address of a peer.
#[derive(Debug)]
pub(crate) struct RejectionLog<P> {
    rings: Mutex<Vec<VecDeque<RejectionRecord<P>>>>,
    /// Of each kind: name, and how many were not kept.
    omitted: [AtomicU64; KINDS],
}

#[derive(Debug)]
struct RejectionRecord<P> {
    at: Nanos,
    /// Orders records of different kinds.
    number: u64,
    peer: P,
    key: Option<ClientKey>,
    reason: Reason,
}

impl<P> RejectionLog<P> {
    pub(crate) fn new() -> Self {
        let ring = || VecDeque::with_capacity(KEPT);
        Self {
            rings: Mutex::new((0..KINDS).map(|_| ring()).collect()),
            omitted: Default::default(),
        }
    }

    /// Notes a rejection; never waits. `number` grows from one to the next.
    pub(crate) fn note(
        &self,
        at: Nanos,
        number: u64,
        peer: P,
        key: Option<ClientKey>,
        reason: Reason,
    ) {
        let omit = || {
            if let Some(omitted) = self.omitted.get(reason.number_and_kind().0) {
                omitted.fetch_add(1, Ordering::Relaxed);
            }
        };
        let Ok(mut rings) = self.rings.try_lock() else {
            omit();
            return;
        };
        let Some(ring) = rings.get_mut(reason.number_and_kind().0) else {
            return;
        };
        if ring.len() >= KEPT {
            ring.pop_front();
            omit();
        }
        ring.push_back(RejectionRecord {
            at,
            number,
            peer,
            key,
            reason,
        });
    }
}

impl<P: fmt::Display> RejectionLog<P> {
    /// Takes all rejections out.
    pub(crate) fn drain(&self) -> Rejections {
        let rings = self.rings.lock();
        let mut rings = rings.unwrap_or_else(PoisonError::into_inner);
        let mut entries: Vec<RejectionRecord<P>> = Vec::with_capacity(KEPT);
        let mut omitted = Vec::new();
        for (ring, count) in rings.iter_mut().zip(&self.omitted) {
            // A count without an entry stays for later, when there is one to name the kind.
            let name = ring.front().map(|entry| entry.reason.kind());
            let count = name.map(|name| (name, count.swap(0, Ordering::Relaxed)));
            omitted.extend(count.filter(|(_, count)| *count > 0));
            entries.extend(ring.drain(..));
        }
        drop(rings);
        entries.sort_by_key(|entry| entry.number);
        let rejection = |entry: RejectionRecord<P>| Rejection {
            at: entry.at,
            peer: entry.peer.to_string(),
            key: entry.key.map(|key| key.to_string()),
            reason: entry.reason,
        };
        Rejections {
            list: entries.into_iter().map(rejection).collect(),
            omitted,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_one_kind_leaves_the_others_alone_and_is_counted() {
        let log = RejectionLog::new();
        log.note(1, 1, "a", None, Reason::Clients { limit: 3 });
        for i in 2..1000 {
            log.note(
                i,
                i,
                "b",
                Some(ClientKey([9; 4])),
                Reason::Malformed { bytes: 7 },
            );
        }
        let rejections = log.drain();
        assert_eq!(rejections.list.len(), 1 + KEPT);
        assert_eq!(rejections.omitted, [("malformed", 998 - KEPT as u64)]);
        let texts: Vec<String> = rejections.list.iter().map(ToString::to_string).collect();
        assert_eq!(
            texts.first().map(String::as_str),
            Some("a: refused a log-in: limits.clients = 3 are there")
        );
        assert_eq!(
            texts.last().map(String::as_str),
            Some("client 09090909 at b: dropped 7 bytes that are no DDS-XRCE message")
        );
        assert_eq!(log.drain(), Rejections::default());
    }

    #[test]
    fn it_never_waits_for_whoever_drains() {
        let log = RejectionLog::new();
        let held = log.rings.lock().unwrap();
        log.note(1, 1, 'p', None, Reason::WrongKey);
        drop(held);
        assert_eq!(log.drain(), Rejections::default());
        log.note(2, 2, 'p', None, Reason::WrongKey);
        assert_eq!(log.drain().omitted, [("wrong_key", 1)]);
    }
}

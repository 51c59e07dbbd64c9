//! The agent's rejections and their reasons, in a bounded log that another thread reads.
//!
//! ```text
//!   agent ──► one ring for each kind, the last 32 of it ──► the thread that drains it
//!                └─ full or being drained: only counted
//! ```
//!
//! Each kind has a ring, so that a flood of one does not push out the others. The agent never
//! waits: while another thread drains, it only counts.

use super::reason::{KINDS, Reason};
use super::subject::Subject;
use replenish_xrce::Nanos;
use replenish_xrce::wire::ClientKey;
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
    /// The sender's address, as in [`ClientSnapshot::peer`](crate::ClientSnapshot::peer).
    pub peer: String,
    /// The client's key as eight hexadecimal digits, if it is known.
    pub key: Option<String>,
    /// The topic, service or node that it is about, if it is about one.
    pub about: Option<Subject>,
    /// The reason.
    pub reason: Reason,
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(key) = &self.key {
            write!(f, "client {key} at ")?;
        }
        write!(f, "{}: ", self.peer)?;
        if let Some(about) = &self.about {
            write!(f, "{about}: ")?;
        }
        write!(f, "{}", self.reason)
    }
}

/// The rejections since the last call.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    /// The last of each kind, all in the order in which they happened.
    pub list: Vec<Rejection>,
    /// Number of older rejections by [kind](Reason::kind); only kinds with some.
    pub omitted: Vec<(&'static str, u64)>,
}

/// The log. `P` is the address of a peer.
#[derive(Debug)]
pub(crate) struct RejectionLog<P> {
    rings: Mutex<Vec<VecDeque<RejectionRecord<P>>>>,
    /// Number of rejections of each kind that were not kept.
    omitted: [AtomicU64; KINDS],
}

#[derive(Debug)]
struct RejectionRecord<P> {
    at: Nanos,
    /// Orders records of different kinds.
    number: u64,
    peer: P,
    key: Option<ClientKey>,
    about: Option<Subject>,
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
        (peer, key): (P, Option<ClientKey>),
        about: Option<Subject>,
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
            about,
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
            about: entry.about,
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
        log.note(1, 1, ("a", None), None, Reason::Clients { limit: 3 });
        for i in 2..1000 {
            log.note(
                i,
                i,
                ("b", Some(ClientKey([9; 4]))),
                None,
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
        log.note(1, 1, ('p', None), None, Reason::WrongKey);
        drop(held);
        assert_eq!(log.drain(), Rejections::default());
        log.note(2, 2, ('p', None), None, Reason::WrongKey);
        assert_eq!(log.drain().omitted, [("wrong_key", 1)]);
    }
}

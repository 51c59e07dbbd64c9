//! An endpoint that is open in DDS: its ends, the others that it talks with, its counters.
//!
//! ```text
//!   matched ──unmatched: goodbye──► (unknown)
//!      │ ▲
//!      │ └──matched again: returned──┐
//!      └──unmatched: lease over──► away        samples sent meanwhile are unheard
//! ```

use super::calls::Calls;
use super::config::{DdsLimits, ServiceMapping};
use super::domain::{Domain, MOST_PEERS};
use super::endpoint::{EndpointKind, Id, Outgoing, RequestId};
use super::prepared::{Asked, Form, Prepared};
use super::qos::{Mismatch, Qos, WINDOW};
use super::report::EndpointCounts;
use replenish_rtps::endpoint::{Header, WriteError};
use replenish_rtps::participant::{Participant, ReaderId, WriterId};
use replenish_rtps::wire::{Guid, GuidPrefix, Timestamp};
use std::collections::HashMap;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A new requester's longest wait, before it sends, until it and a server have found each other.
const SERVER_WAIT: Duration = Duration::from_secs(2);

pub(super) enum Role {
    Plain,
    Requester {
        calls: Calls<(Form, i64), RequestId>,
        /// The last number of Cyclone's form.
        last: i64,
    },
    Replier {
        calls: Calls<RequestId, Asked>,
    },
}

/// An open endpoint.
pub(super) struct OpenEndpoint {
    pub(super) domain: u16,
    pub(super) node: Option<Id>,
    pub(super) writer: Option<WriterId>,
    pub(super) reader: Option<ReaderId>,
    pub(super) role: Role,
    pub(super) services: ServiceMapping,
    pub(super) prefix: GuidPrefix,
    /// The time until which requests wait for a server to be found.
    early: Option<Instant>,
    pub(super) readers: Vec<Guid>,
    writers: Vec<Guid>,
    /// Readers and writers of silent participants, with the samples that were sent until then.
    away: Vec<(Guid, u64)>,
    /// The last sample of each writer that is heard.
    last: HashMap<Guid, i64>,
    /// A requester's server knows both of its ends.
    known: bool,
    /// Samples handed to DDS so far.
    sent: u64,
    /// Since the last hand-over: the counters, and the policies of all that did not match.
    pub(super) counts: EndpointCounts,
    pub(super) mismatch: Mismatch,
}

impl OpenEndpoint {
    pub(super) fn open(
        domain: &mut Domain,
        number: u16,
        node: Option<Id>,
        kind: &EndpointKind,
        (services, limits): (ServiceMapping, &DdsLimits),
    ) -> Result<Self, String> {
        let (reads, writes, role) = match kind {
            EndpointKind::Writer { topic, qos } => (None, Some((topic, *qos)), Role::Plain),
            EndpointKind::Reader { topic, qos } => (Some((topic, *qos)), None, Role::Plain),
            EndpointKind::Requester { request, reply } => {
                let calls = Calls::new(limits.calls);
                let role = Role::Requester { calls, last: 0 };
                (service(reply), service(request), role)
            }
            EndpointKind::Replier { request, reply } => {
                let calls = Calls::new(limits.calls);
                (service(request), service(reply), Role::Replier { calls })
            }
        };
        let reader = reads.map(|(topic, qos)| domain.reader(topic, &qos));
        let reader = reader.transpose()?;
        let writer = writes.map(|(topic, qos)| domain.writer(topic, &qos));
        let writer = match writer.transpose() {
            Ok(writer) => writer,
            Err(why) => {
                if let Some(reader) = reader {
                    let now = replenish_os::clock::monotonic();
                    domain.participant.remove_reader(reader, now);
                }
                return Err(why);
            }
        };
        let calls = matches!(role, Role::Requester { .. });
        let early = calls.then(|| Instant::now() + SERVER_WAIT);
        Ok(Self {
            domain: number,
            node,
            writer,
            reader,
            role,
            services,
            prefix: domain.prefix(),
            early,
            readers: Vec::new(),
            writers: Vec::new(),
            away: Vec::new(),
            last: HashMap::new(),
            known: false,
            sent: 0,
            counts: EndpointCounts::default(),
            mismatch: Mismatch::default(),
        })
    }

    /// Number of others' endpoints that it talks with.
    pub(super) fn matched(&self) -> usize {
        self.readers.len() + self.writers.len()
    }

    /// Whether there is somebody to hear it and somebody to answer: for a requester, a server.
    pub(super) fn is_served(&self) -> bool {
        match &self.role {
            Role::Requester { .. } => self.known,
            _ => !self.readers.is_empty() && !self.writers.is_empty(),
        }
    }

    /// Looks whether the server of a requester has found it, too.
    pub(super) fn look(&mut self, participant: &Participant) {
        if let (Role::Requester { .. }, Some(writer), Some(reader)) =
            (&self.role, self.writer, self.reader)
        {
            self.known = participant.has_counterpart(writer, reader);
        }
    }

    /// A reader (of its writer) or writer (of its reader) was found.
    pub(super) fn found(&mut self, theirs: Guid) {
        let reads = theirs.entity.is_reader();
        let list = if reads {
            &mut self.readers
        } else {
            &mut self.writers
        };
        if list.len() < MOST_PEERS && !list.contains(&theirs) {
            list.push(theirs);
        }
        if let Some(at) = self.away.iter().position(|(guid, _)| *guid == theirs) {
            let (_, sent) = self.away.swap_remove(at);
            self.counts.returned += 1;
            if reads {
                self.counts.unheard += self.sent.saturating_sub(sent);
            }
        }
    }

    /// A reader or writer is gone, because its participant was `silent` or by its own word.
    pub(super) fn lost(&mut self, theirs: Guid, silent: bool) {
        self.readers.retain(|guid| *guid != theirs);
        self.writers.retain(|guid| *guid != theirs);
        self.last.remove(&theirs);
        if !silent {
            return;
        }
        self.counts.lost += 1;
        if theirs.entity.is_reader() {
            // Samples on their way are not sent again.
            self.counts.unheard += self.sent.min(WINDOW as u64);
        }
        if self.away.len() >= MOST_PEERS {
            self.away.remove(0);
        }
        self.away.push((theirs, self.sent));
    }

    /// Whether a sample should wait a little: a new requester and its server have not found each
    /// other yet, or a replier has not found the reader of the program that asked.
    pub(super) fn is_early(&mut self, next: &Outgoing) -> bool {
        if let Role::Replier { calls } = &self.role {
            let asked = next.request.and_then(|request| calls.get(&request));
            let known = |from: Guid| self.readers.iter().any(|guid| guid.prefix == from.prefix);
            return asked.is_some_and(|a| !known(a.from) && Instant::now() < a.until);
        }
        if self.known || self.early.is_some_and(|until| until <= Instant::now()) {
            self.early = None;
        }
        self.early.is_some()
    }

    /// Hands a sample to DDS; gives it back if its window is full.
    pub(super) fn submit(
        &mut self,
        domain: &mut Domain,
        prepared: Prepared,
    ) -> Result<(), Prepared> {
        let Some(writer) = self.writer else {
            self.counts.dropped_out += 1;
            return Ok(());
        };
        let source = SystemTime::now().duration_since(UNIX_EPOCH).ok();
        let source = source.and_then(|time| u64::try_from(time.as_nanos()).ok());
        let header = Header {
            source: source.map(Timestamp),
            related: prepared.related,
            only: prepared.only,
            ..Header::default()
        };
        match domain.write(writer, &prepared.payload, &header) {
            Ok(number) => {
                self.counts.sent += 1;
                self.sent += 1;
                if let (Role::Requester { calls, .. }, Some((request, form, own))) =
                    (&mut self.role, prepared.call)
                {
                    let number = match form {
                        Form::Enhanced => number,
                        Form::Cyclone => own,
                    };
                    self.counts.calls_lost += u64::from(calls.add((form, number), request));
                }
                Ok(())
            }
            Err(WriteError::Full) => Err(prepared),
            Err(_) => {
                self.counts.dropped_out += 1;
                Ok(())
            }
        }
    }

    /// Counts what a writer has sent and this reader did not get.
    pub(super) fn notice_gap(&mut self, from: Guid, sequence: i64) {
        if let Some(last) = self.last.get_mut(&from) {
            let gap = sequence.saturating_sub(*last).saturating_sub(1);
            self.counts.missed += u64::try_from(gap).unwrap_or(0);
            *last = sequence.max(*last);
        } else if self.last.len() < MOST_PEERS {
            self.last.insert(from, sequence);
        }
    }
}

/// An end of a service, with ROS 2's quality of service for services.
fn service(topic: &super::endpoint::Topic) -> Option<(&super::endpoint::Topic, Qos)> {
    Some((topic, Qos::default()))
}

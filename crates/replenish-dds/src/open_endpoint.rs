//! An endpoint that is open in DDS.
//!
//! ```text
//!   requester:  request ──► writer: sequence number ──► table ◄── reply's related identity ── reader
//!   replier:    reader: request's identity ──► table ◄── reply ──► writer: related identity
//! ```

use crate::calls::Calls;
use crate::config::{DdsLimits, ServiceMapping};
use crate::domain::{Domain, Reader, Writer};
use crate::endpoint::{EndpointKind, Id, Incoming, Outgoing, RequestId};
use crate::header::{self, Header};
use crate::qos::Qos;
use crate::state::Counts;
use rustdds::bytes::Bytes;
use rustdds::dds::{ReadError, WriteError};
use rustdds::no_key::DeserializedCacheChange;
use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, RTPSEntity, SequenceNumber, Timestamp, WriteOptionsBuilder};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// How long a new requester waits for a server to be found before it sends.
const SERVER_WAIT: Duration = Duration::from_secs(2);

/// How long it waits after that for the server to find it, too: a reply to somebody who is not
/// known yet is lost, and nothing tells the client when it is known.
const DISCOVERY_TIME: Duration = Duration::from_millis(100);

/// How long a reply waits for the reader that it is for to be found: a program asks as soon as it
/// has found the server, and the server may find the program's reader later. As `rmw_fastrtps` has
/// it.
const READER_WAIT: Duration = Duration::from_millis(100);

/// Writers and readers of others that are remembered per endpoint.
const MAX_MATCHED: usize = 1024;

/// The form of a request and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Enhanced,
    Cyclone,
}

enum Role {
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

/// A request from DDS that waits for its reply.
struct Asked {
    form: Form,
    from: GUID,
    /// Until when its reply waits for a reader of the program that asked.
    until: Instant,
}

/// An open endpoint.
pub(crate) struct OpenEndpoint {
    pub(crate) domain: u16,
    pub(crate) node: Option<Id>,
    pub(crate) writer: Option<Writer>,
    pub(crate) reader: Option<Reader>,
    pub(crate) kind: EndpointKind,
    role: Role,
    services: ServiceMapping,
    participant: GUID,
    /// A volatile reader wants nothing from before: RustDDS's cache outlives readers.
    since: Option<Timestamp>,
    /// Until when requests wait for a server to be found.
    early: Option<Instant>,
    readers: Vec<GUID>,
    writers: Vec<GUID>,
    /// The last sample of each writer that is heard.
    last: HashMap<GUID, i64>,
    /// Samples handed to DDS so far.
    pub(crate) sent: u64,
    pub(crate) counts: Counts,
}

/// A sample as it goes to DDS.
pub(crate) struct Prepared {
    bytes: Bytes,
    related: Option<SampleIdentity>,
    /// The program's name for the request, and its form.
    call: Option<(RequestId, Form, i64)>,
}

impl OpenEndpoint {
    pub(crate) fn open(
        domain: &mut Domain,
        number: u16,
        node: Option<Id>,
        kind: &EndpointKind,
        (services, limits): (ServiceMapping, &DdsLimits),
        retyped: bool,
    ) -> Result<Self, String> {
        let since = Timestamp::now();
        let service = Qos::default();
        let (writer, reader, role, volatile) = match kind {
            EndpointKind::Writer { topic, qos } => {
                (Some(domain.writer(topic, qos)?), None, Role::Plain, true)
            }
            EndpointKind::Reader { topic, qos } => {
                let reader = domain.reader(topic, qos)?;
                (
                    None,
                    Some(reader),
                    Role::Plain,
                    qos.is_volatile() || retyped,
                )
            }
            EndpointKind::Requester { request, reply } => {
                let reader = domain.reader(reply, &service)?;
                let writer = domain.writer(request, &service)?;
                let role = Role::Requester {
                    calls: Calls::new(limits.calls),
                    last: 0,
                };
                (Some(writer), Some(reader), role, true)
            }
            EndpointKind::Replier { request, reply } => {
                let writer = domain.writer(reply, &service)?;
                let reader = domain.reader(request, &service)?;
                let role = Role::Replier {
                    calls: Calls::new(limits.calls),
                };
                (Some(writer), Some(reader), role, true)
            }
        };
        let calls = matches!(role, Role::Requester { .. });
        let early = calls.then(|| Instant::now() + SERVER_WAIT);
        Ok(Self {
            domain: number,
            node,
            writer,
            reader,
            kind: kind.clone(),
            role,
            services,
            participant: domain.guid(),
            since: volatile.then_some(since),
            early,
            readers: Vec::new(),
            writers: Vec::new(),
            last: HashMap::new(),
            sent: 0,
            counts: Counts::default(),
        })
    }

    /// How many of others it talks with.
    pub(crate) fn matched(&self) -> usize {
        self.readers.len() + self.writers.len()
    }

    /// The readers (true) and writers of others that it talks with.
    pub(crate) fn matches(&self) -> impl Iterator<Item = (GUID, bool)> {
        let readers = self.readers.iter().map(|guid| (*guid, true));
        readers.chain(self.writers.iter().map(|guid| (*guid, false)))
    }

    /// Whether there is somebody to hear it and somebody to answer: for a requester, a server.
    pub(crate) fn is_served(&self) -> bool {
        !self.readers.is_empty() && !self.writers.is_empty()
    }

    /// A reader (of its writer) or writer (of its reader) was found.
    pub(crate) fn found(&mut self, guid: GUID, reads: bool) {
        let list = if reads {
            &mut self.readers
        } else {
            &mut self.writers
        };
        let own = guid.prefix == self.participant.prefix;
        if !own && list.len() < MAX_MATCHED && !list.contains(&guid) {
            list.push(guid);
        }
        let found = !self.readers.is_empty() && !self.writers.is_empty();
        if let (true, Some(early)) = (found, &mut self.early) {
            *early = (*early).min(Instant::now() + DISCOVERY_TIME);
        }
    }

    /// Removes lost readers and writers.
    pub(crate) fn lost(&mut self, which: impl Fn(&GUID) -> bool) {
        self.readers.retain(|guid| !which(guid));
        self.writers.retain(|guid| !which(guid));
        self.last.retain(|guid, _| !which(guid));
    }

    /// Whether a sample should wait a little: a new requester has not found its server yet, or a
    /// replier the reader of the program that asked.
    pub(crate) fn is_early(&mut self, next: &Outgoing) -> bool {
        if let Role::Replier { calls } = &self.role {
            let asked = next.request.and_then(|request| calls.get(&request));
            let known = |from: GUID| self.readers.iter().any(|guid| guid.prefix == from.prefix);
            return asked.is_some_and(|a| !known(a.from) && Instant::now() < a.until);
        }
        if self.early.is_some_and(|until| until <= Instant::now()) {
            self.early = None;
        }
        self.early.is_some()
    }

    /// Gives a sample its form on the wire, or `None` for a reply to an unknown request.
    pub(crate) fn prepare(&mut self, outgoing: Outgoing) -> Option<Prepared> {
        let Outgoing { payload, request } = outgoing;
        let plain = |payload: Vec<u8>| Prepared {
            bytes: Bytes::from(payload),
            related: None,
            call: None,
        };
        match &mut self.role {
            Role::Plain => Some(plain(payload)),
            Role::Requester { last, .. } => {
                let request = request?;
                let all_cyclone = !self.readers.is_empty() && self.readers.iter().all(is_cyclone);
                let form = match self.services {
                    ServiceMapping::Enhanced => Form::Enhanced,
                    ServiceMapping::Cyclone => Form::Cyclone,
                    ServiceMapping::Auto if all_cyclone => Form::Cyclone,
                    ServiceMapping::Auto => Form::Enhanced,
                };
                if form == Form::Cyclone {
                    *last += 1;
                    let header = Header {
                        client: client(self.writer.as_ref()?.guid()),
                        sequence: *last,
                    };
                    let mut prepared = plain(header.before(&payload));
                    prepared.call = Some((request, form, *last));
                    return Some(prepared);
                }
                // As rmw_fastrtps: whom to wait for before the reply is sent.
                let mut prepared = plain(payload);
                prepared.related = Some(SampleIdentity {
                    writer_guid: self.reader.as_ref()?.guid(),
                    sequence_number: SequenceNumber::UNKNOWN,
                });
                prepared.call = Some((request, form, 0));
                Some(prepared)
            }
            Role::Replier { calls } => {
                let request = request?;
                let Some(asked) = calls.take(&request) else {
                    self.counts.calls_lost += 1;
                    return None;
                };
                if asked.form == Form::Cyclone {
                    let header = Header {
                        client: client(GUID::from_bytes(request.guid)),
                        sequence: request.sequence,
                    };
                    return Some(plain(header.before(&payload)));
                }
                let mut prepared = plain(payload);
                prepared.related = Some(SampleIdentity {
                    writer_guid: GUID::from_bytes(request.guid),
                    sequence_number: SequenceNumber::new(request.sequence),
                });
                Some(prepared)
            }
        }
    }

    /// Hands a sample to DDS; gives it back if its window is full.
    pub(crate) fn submit(&mut self, prepared: Prepared) -> Result<(), Prepared> {
        let Some(writer) = &self.writer else {
            self.counts.dropped_out += 1;
            return Ok(());
        };
        let Prepared {
            bytes,
            related,
            call,
        } = prepared;
        let options = WriteOptionsBuilder::new()
            .source_timestamp(Timestamp::now())
            .related_sample_identity_opt(related)
            .build();
        match writer.write_with_options(bytes, options) {
            Ok(identity) => {
                self.counts.sent += 1;
                self.sent += 1;
                if let (Role::Requester { calls, .. }, Some((request, form, number))) =
                    (&mut self.role, call)
                {
                    let number = match form {
                        Form::Enhanced => i64::from(identity.sequence_number),
                        Form::Cyclone => number,
                    };
                    self.counts.calls_lost += u64::from(calls.add((form, number), request));
                }
                Ok(())
            }
            Err(WriteError::WouldBlock { data: bytes }) => Err(Prepared {
                bytes,
                related,
                call,
            }),
            Err(_) => {
                self.counts.dropped_out += 1;
                Ok(())
            }
        }
    }

    /// The next sample from others; `None` when there is none now.
    pub(crate) fn take(&mut self) -> Option<Incoming> {
        loop {
            let reader = self.reader.as_ref()?;
            match reader.try_take_one() {
                Ok(None) => return None,
                Ok(Some(sample)) => {
                    if let Some(incoming) = self.accept(sample) {
                        return Some(incoming);
                    }
                }
                Err(ReadError::Deserialization { .. }) => self.counts.dropped_in += 1,
                Err(_) => return None,
            }
        }
    }

    fn accept(&mut self, sample: DeserializedCacheChange<Vec<u8>>) -> Option<Incoming> {
        let from = sample.writer_guid;
        let old = self
            .since
            .is_some_and(|since| sample.receive_instant < since);
        if old || from.prefix == self.participant.prefix {
            return None;
        }
        let cyclone = match self.services {
            ServiceMapping::Auto => is_cyclone(&from),
            ServiceMapping::Enhanced => false,
            ServiceMapping::Cyclone => true,
        };
        let related = sample.related_sample_identity();
        let sequence = i64::from(sample.sequence_number);
        self.notice_gap(from, sequence);
        let mut payload = sample.into_value();
        let header = if cyclone && !matches!(self.role, Role::Plain) {
            let Some(header) = Header::split(&mut payload) else {
                self.counts.dropped_in += 1;
                return None;
            };
            Some(header)
        } else {
            None
        };
        let request = match &mut self.role {
            Role::Plain => None,
            Role::Requester { calls, .. } => {
                let writer = self.writer.as_ref()?.guid();
                let (mine, key) = match (header, related) {
                    (Some(header), _) => {
                        let mine = header.client == client(writer);
                        (mine, (Form::Cyclone, header.sequence))
                    }
                    (None, Some(id)) => {
                        let reader = self.reader.as_ref()?.guid();
                        let mine = [writer, reader].contains(&id.writer_guid);
                        (mine, (Form::Enhanced, i64::from(id.sequence_number)))
                    }
                    (None, None) => {
                        self.counts.calls_lost += 1;
                        return None;
                    }
                };
                if !mine {
                    return None; // another client's
                }
                let Some(request) = calls.take(&key) else {
                    self.counts.calls_lost += 1;
                    return None;
                };
                Some(request)
            }
            Role::Replier { calls } => {
                let (request, form) = match header {
                    Some(header) => {
                        let mut guid = from.to_bytes();
                        let (_, low) = guid.split_at_mut(8);
                        low.copy_from_slice(&header.client);
                        let sequence = header.sequence;
                        (RequestId { guid, sequence }, Form::Cyclone)
                    }
                    None => (enhanced(from, sequence, related), Form::Enhanced),
                };
                let until = Instant::now() + READER_WAIT;
                let asked = Asked { form, from, until };
                self.counts.calls_lost += u64::from(calls.add(request, asked));
                Some(request)
            }
        };
        Some(Incoming { payload, request })
    }
}

impl OpenEndpoint {
    fn notice_gap(&mut self, from: GUID, sequence: i64) {
        if let Some(last) = self.last.get_mut(&from) {
            let gap = sequence.saturating_sub(*last).saturating_sub(1);
            self.counts.missed += u64::try_from(gap).unwrap_or(0);
            *last = sequence.max(*last);
        } else if self.last.len() < MAX_MATCHED {
            self.last.insert(from, sequence);
        }
    }
}

/// The client's name in Cyclone's form.
fn client(writer: GUID) -> [u8; 8] {
    let bytes = writer.to_bytes();
    let mut client = [0; 8];
    client.copy_from_slice(bytes.split_at(8).1);
    client
}

fn is_cyclone(guid: &GUID) -> bool {
    header::is_cyclone(guid.prefix.as_ref())
}

/// The identity to answer to.
fn enhanced(from: GUID, sequence: i64, related: Option<SampleIdentity>) -> RequestId {
    let related = related.map(|id| (id.writer_guid.to_bytes(), i64::from(id.sequence_number)));
    let (guid, sequence) = header::enhanced((from.to_bytes(), sequence), related);
    RequestId { guid, sequence }
}

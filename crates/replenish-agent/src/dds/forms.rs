//! Samples on their way: in which form they leave, and which request one belongs to that comes.
//!
//! ```text
//!   requester:  request ──► writer: sequence number ──► table ◄── reply's related identity ── reader
//!   replier:    reader: request's identity ──► table ◄── reply ──► writer: related identity
//! ```

use super::config::ServiceMapping;
use super::endpoint::{Incoming, Outgoing, RequestId};
use super::header::{self, Header};
use super::open_endpoint::{OpenEndpoint, Role};
use super::prepared::{Asked, Form, Prepared};
use replenish_rtps::endpoint::Sample;
use replenish_rtps::wire::{CDR_LE, Guid, SampleIdentity};
use std::time::{Duration, Instant};

/// The longest wait of a reply for its reader to be found: a program asks as soon as it
/// has found the server, and the server may find the program's reader later. As `rmw_fastrtps` has
/// it.
const READER_WAIT: Duration = Duration::from_millis(100);

impl OpenEndpoint {
    /// Gives a sample its form on the wire, or `None` for a reply to an unknown request.
    pub(super) fn prepare(&mut self, outgoing: Outgoing) -> Option<Prepared> {
        let Outgoing { payload, request } = outgoing;
        let own = |entity| Guid::new(self.prefix, entity);
        match &mut self.role {
            Role::Plain => Some(Prepared::plain(payload)),
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
                        client: client(own(self.writer?.entity())),
                        sequence: *last,
                    };
                    let mut prepared = Prepared::plain(header.before(&payload));
                    prepared.call = Some((request, form, *last));
                    return Some(prepared);
                }
                // As rmw_fastrtps: whom to wait for before the reply is sent.
                let mut prepared = Prepared::plain(payload);
                prepared.related = Some(SampleIdentity {
                    guid: own(self.reader?.entity()),
                    sn: SampleIdentity::OWN,
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
                let mut prepared = if asked.form == Form::Cyclone {
                    let header = Header {
                        client: low(request.guid),
                        sequence: request.sequence,
                    };
                    Prepared::plain(header.before(&payload))
                } else {
                    Prepared {
                        related: Some(asked.to),
                        ..Prepared::plain(payload)
                    }
                };
                prepared.only = Some(asked.from.prefix);
                Some(prepared)
            }
        }
    }

    /// A sample from others; `None` if it is for somebody else, or damaged.
    pub(super) fn accept(&mut self, sample: &Sample<'_>) -> Option<Incoming> {
        let from = sample.writer;
        if sample.gone.is_some() {
            return None; // an instance, of which ROS 2 has none
        }
        let cyclone = match self.services {
            ServiceMapping::Auto => is_cyclone(&from),
            ServiceMapping::Enhanced => false,
            ServiceMapping::Cyclone => true,
        };
        let sequence = sample.sn;
        self.notice_gap(from, sequence);
        // The two bytes after the representation are options.
        let little_endian = sample.payload.get(..2) == CDR_LE.get(..2);
        let Some(payload) = sample.payload.get(4..).filter(|_| little_endian) else {
            self.counts.dropped_in += 1;
            return None;
        };
        let mut payload = payload.to_vec();
        let header = if cyclone && !matches!(self.role, Role::Plain) {
            let Some(header) = Header::split(&mut payload) else {
                self.counts.dropped_in += 1;
                return None;
            };
            Some(header)
        } else {
            None
        };
        let own = |entity| Guid::new(self.prefix, entity);
        let request = match &mut self.role {
            Role::Plain => None,
            Role::Requester { calls, .. } => {
                let writer = own(self.writer?.entity());
                let (mine, key) = match (header, sample.related) {
                    (Some(header), _) => {
                        let mine = header.client == client(writer);
                        (mine, (Form::Cyclone, header.sequence))
                    }
                    (None, Some(id)) => {
                        let reader = own(self.reader?.entity());
                        let mine = [writer, reader].contains(&id.guid);
                        (mine, (Form::Enhanced, id.sn))
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
                let (request, form, to) = match header {
                    Some(header) => {
                        let mut guid = from.to_bytes();
                        let (_, end) = guid.split_at_mut(8);
                        end.copy_from_slice(&header.client);
                        let sequence = header.sequence;
                        let to = SampleIdentity {
                            guid: from,
                            sn: sequence,
                        };
                        (RequestId { guid, sequence }, Form::Cyclone, to)
                    }
                    None => {
                        let (request, to) = enhanced(from, sequence, sample.related);
                        (request, Form::Enhanced, to)
                    }
                };
                let asked = Asked {
                    form,
                    to,
                    from,
                    until: Instant::now() + READER_WAIT,
                };
                self.counts.calls_lost += u64::from(calls.add(request, asked));
                Some(request)
            }
        };
        Some(Incoming { payload, request })
    }
}

/// The client's name in Cyclone's form.
fn client(writer: Guid) -> [u8; 8] {
    low(writer.to_bytes())
}

fn low(guid: [u8; 16]) -> [u8; 8] {
    let mut client = [0; 8];
    client.copy_from_slice(guid.split_at(8).1);
    client
}

fn is_cyclone(guid: &Guid) -> bool {
    header::is_cyclone(&guid.prefix.0)
}

/// The identity to answer to.
fn enhanced(
    from: Guid,
    sequence: i64,
    related: Option<SampleIdentity>,
) -> (RequestId, SampleIdentity) {
    let own = (from.to_bytes(), sequence);
    let named = related.map(|id| (id.guid.to_bytes(), id.sn));
    let (guid, sequence) = header::enhanced(own, named);
    let to = match related {
        Some(id) if id.guid.to_bytes() == guid => id.guid,
        _ => from,
    };
    (
        RequestId { guid, sequence },
        SampleIdentity {
            guid: to,
            sn: sequence,
        },
    )
}

//! The state under the session lock, as plain structs: the session, its endpoints, and the objects
//! at the agent that they stand for. The files that act on them import this one, and never the
//! reverse.
#![cfg_attr(
    not(feature = "full"),
    allow(dead_code, reason = "fields for endpoints that are deleted")
)]

use super::backlog::{Backlog, Flow};
use super::flags::StatusFlags;
use super::limits::{CLASHES, RELIABLE_STREAMS, REQUESTS, STREAMS, WINDOW};
use super::registry::{Numbers, PendingDeletes, Slots};
use super::socket_stats::SocketStats;
use crate::Nanos;
use crate::middleware::{Interest, ReaderId, Room, SampleInfo};
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_xrce::client::Session;
use replenish_xrce::wire::{ObjectId, RequestId, Status, StreamId};

pub(super) type XrceSession = Session<Box<[u8]>, WINDOW, REQUESTS, STREAMS, RELIABLE_STREAMS>;

pub(super) struct State {
    pub(super) session: Box<XrceSession>,
    pub(super) endpoints: Endpoints,
    /// The names of nodes, whose participants have the numbers from 1 on.
    pub(super) participants: Vec<String>,
    pub(super) topics: Vec<Topic>,
    pub(super) reader_numbers: Numbers,
    pub(super) writer_numbers: Numbers,
    pub(super) topic_numbers: Numbers,
    /// Objects that the agent is to delete.
    pub(super) pending_deletes: PendingDeletes,
    /// The agent was lost, and what it may send after its return is to be determined anew.
    pub(super) regrant: bool,
    /// The instant to which the timer is set.
    pub(super) armed: Nanos,
    /// The transport has no room at the moment.
    pub(super) blocked: bool,
    pub(super) socket: SocketStats,
}

impl State {
    pub(super) fn new(session: Box<XrceSession>) -> Self {
        Self {
            session,
            endpoints: Endpoints {
                clashes: Vec::with_capacity(CLASHES),
                ..Endpoints::default()
            },
            participants: Vec::new(),
            topics: Vec::new(),
            reader_numbers: Numbers::default(),
            writer_numbers: Numbers::default(),
            topic_numbers: Numbers::default(),
            pending_deletes: PendingDeletes::new(),
            regrant: false,
            armed: Nanos::MAX,
            blocked: false,
            socket: SocketStats::default(),
        }
    }
}

/// The targets of the agent's messages.
#[derive(Default)]
pub(super) struct Endpoints {
    pub(super) flags: Arc<StatusFlags>,
    pub(super) readers: Vec<Reader>,
    pub(super) writers: Vec<Writer>,
    pub(super) slots: Slots,
    /// The agent's refusal of the session, if that was its last word.
    pub(super) refused: Option<Status>,
    /// The latest answer to a question for the agent's time: how far it is ahead.
    pub(super) agent_time: Option<i64>,
    /// Some reader gets no more samples from the agent until it is granted some.
    pub(super) spent: bool,
    /// Readers with a backlog.
    pub(super) pending: Interest,
    /// Objects that do not talk with others, and why; not told yet.
    pub(super) clashes: Vec<(ObjectId, u8)>,
}

pub(super) struct Reader {
    pub(super) object: ObjectId,
    /// Its topic object; services have none.
    pub(super) topic: Option<ObjectId>,
    pub(super) max_size: usize,
    pub(super) backlog: Backlog,
    pub(super) lost: u64,
    /// How a keep-all reader holds the agent back.
    pub(super) flow: Option<Box<Flow>>,
    /// It was deleted; its slot is free.
    pub(super) deleted: bool,
}

impl Reader {
    /// Counts a sample that `request` asked for, arrived or lost. Whether to ask for more now.
    pub(super) fn spend(&mut self, request: RequestId) -> bool {
        let Some(flow) = &mut self.flow else {
            return false;
        };
        flow.arrived(request);
        flow.is_spent()
    }
}

pub(super) struct Writer {
    pub(super) object: ObjectId,
    /// Its topic object; services have none.
    pub(super) topic: Option<ObjectId>,
    pub(super) stream: StreamId,
    pub(super) max_size: usize,
    /// Its object was deleted.
    pub(super) closed: bool,
    /// And nobody uses it any more: its slot is free.
    pub(super) free: bool,
    /// A requester: the agent knows a server.
    pub(super) served: bool,
}

impl Writer {
    pub(super) const fn new(
        object: ObjectId,
        topic: Option<ObjectId>,
        stream: StreamId,
        max_size: usize,
    ) -> Self {
        Self {
            object,
            topic,
            stream,
            max_size,
            closed: false,
            free: false,
            served: false,
        }
    }
}

pub(super) struct Topic {
    pub(super) participant: ObjectId,
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) object: ObjectId,
    /// Readers and writers.
    pub(super) users: usize,
}

/// The sink of [`Middleware::take`](crate::middleware::Middleware::take).
pub(super) type Sink<'a> = dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room + 'a;

/// Where the samples of a round go.
pub(super) struct Round<'a, 'b> {
    /// Readers to deliver to. A full reader is removed.
    pub(super) interest: &'a mut Interest,
    pub(super) sink: &'a mut Sink<'b>,
    /// Samples that went there.
    pub(super) taken: usize,
}

impl Round<'_, '_> {
    /// Hands a sample over.
    pub(super) fn give(&mut self, reader: ReaderId, info: &SampleInfo, sample: &[u8]) {
        self.taken += 1;
        if (self.sink)(reader, info, sample) == Room::Full {
            self.interest.remove(reader);
        }
    }
}

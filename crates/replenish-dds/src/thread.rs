//! The thread that owns DDS.
//!
//! ```text
//!   wait ──► close, open ──► matches ──► samples in ──► samples out ──► counters, node graph ──┐
//!    ▲        (work)        (statuses)  (BATCH each)   (all, in turn)                          │
//!    └─────────────────────────────────────────────────────────────────────────────────────────┘
//! ```

use crate::config::DdsConfig;
use crate::domain::Domain;
use crate::endpoint::{Id, Node, Topic};
use crate::graph::NodeInfo;
use crate::open_endpoint::{OpenEndpoint, Prepared};
use crate::qos::Mismatch;
use crate::returns::Returns;
use crate::state::{Counts, DdsEntity, SharedState};
use rustdds::mio1::{Events, Interest, Poll, Token};
use rustdds::{
    DomainParticipantStatusEvent as Status, GUID, LostReason, RTPSEntity, StatusEvented,
};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::Duration;

/// The token of wake-ups.
pub(crate) const WAKE: Token = Token(0);

/// Above it are the tokens of domains, and above 2^16 + it those of readers.
const DOMAINS: usize = 1;
const READERS: usize = DOMAINS + (1 << 16);

/// Samples taken from one reader before the others have their turn, and written in one go.
const BATCH: usize = 64;

/// The interval of retries for full writers and undiscovered servers.
const AGAIN: Duration = Duration::from_millis(5);

/// The thread's own state.
pub(crate) struct Engine {
    config: DdsConfig,
    shared: Arc<SharedState>,
    poll: Poll,
    domains: BTreeMap<u16, Domain>,
    nodes: BTreeMap<Id, Node>,
    live: BTreeMap<Id, OpenEndpoint>,
    /// The owners of writers and readers, by GUID.
    owners: HashMap<GUID, Id>,
    tokens: HashMap<usize, Id>,
    next_token: usize,
    /// Readers that may have samples.
    readable: BTreeSet<Id>,
    /// Samples that DDS had no room for, one each; their queues are paused. `None`: waits for a
    /// server.
    blocked: BTreeMap<Id, Option<Prepared>>,
    returns: Returns,
}

/// Wakes the program when the thread ends, for whatever reason.
struct Ending(Arc<SharedState>);

impl Drop for Ending {
    fn drop(&mut self) {
        self.0
            .table
            .lock()
            .end("the thread of DDS panicked or its poll failed".into());
        self.0.program.wake();
    }
}

impl Engine {
    pub(crate) fn new(config: DdsConfig, shared: Arc<SharedState>, poll: Poll) -> Self {
        Self {
            config,
            shared,
            poll,
            domains: BTreeMap::new(),
            nodes: BTreeMap::new(),
            live: BTreeMap::new(),
            owners: HashMap::new(),
            tokens: HashMap::new(),
            next_token: READERS,
            readable: BTreeSet::new(),
            blocked: BTreeMap::new(),
            returns: Returns::default(),
        }
    }

    pub(crate) fn run(mut self) {
        let _ending = Ending(Arc::clone(&self.shared));
        let mut events = Events::with_capacity(256);
        while self.turn(&mut events) {}
    }

    /// One round; returns whether there is another.
    fn turn(&mut self, events: &mut Events) -> bool {
        let idle = self.readable.is_empty() && self.shared.table.lock().outgoing.is_empty();
        let timeout = match (idle, self.blocked.is_empty()) {
            (false, _) => Some(Duration::ZERO),
            (true, false) => Some(AGAIN),
            (true, true) => self.returns.timeout(),
        };
        if let Err(error) = self.poll.poll(events, timeout)
            && error.kind() != std::io::ErrorKind::Interrupted
        {
            return false;
        }
        for event in events.iter() {
            if let Some(id) = self.tokens.get(&event.token().0) {
                self.readable.insert(*id);
            }
        }
        let work = self.shared.table.lock().take_work();
        if work.stop {
            return false;
        }
        work.closes.into_iter().for_each(|id| self.close(id));
        for (id, entity) in work.opens {
            let opened = self.open(id, entity);
            self.shared.table.lock().opened(id, opened);
        }
        self.statuses();
        self.returns.remind(&mut self.domains, &self.live);
        self.receive();
        self.send();
        self.account();
        self.tell();
        true
    }

    fn open(&mut self, id: Id, entity: DdsEntity) -> Result<(), String> {
        let number = entity.domain();
        let endpoint = match entity {
            DdsEntity::Node(node) => {
                self.join(number)?.changed = true;
                self.nodes.insert(id, node);
                return Ok(());
            }
            DdsEntity::Endpoint(endpoint) => endpoint,
        };
        let kind = &endpoint.kind;
        let here = || self.live.values().filter(|live| live.domain == number);
        let unused = here().next().is_none();
        let is_used = |topic: &&Topic| {
            let mut topics = here().flat_map(|live| live.kind.topics());
            topics.any(|used| used.name == topic.name)
        };
        let free: Vec<&Topic> = kind.topics().filter(|topic| !is_used(topic)).collect();
        let is_full = |domain: &Domain| kind.topics().any(|topic| domain.is_full_for(topic));
        if unused && self.domains.get(&number).is_some_and(is_full) {
            self.leave(number); // and with it the caches of all topics there were
        }
        let how = (self.config.services, self.config.limits);
        let domain = self.join(number)?;
        domain.changed = true;
        let retyped = free
            .into_iter()
            .filter(|topic| domain.retype(topic))
            .count()
            > 0;
        let (services, limits) = how;
        let how = (services, &limits);
        let mut live = OpenEndpoint::open(domain, number, endpoint.node, kind, how, retyped)?;
        if let Some(reader) = &mut live.reader {
            let token = Token(self.next_token);
            self.next_token += 1;
            self.poll
                .registry()
                .register(reader, token, Interest::READABLE)
                .map_err(|error| format!("cannot wait for a reader: {error}"))?;
            self.tokens.insert(token.0, id);
            self.owners.insert(reader.guid(), id);
            self.readable.insert(id);
        }
        if let Some(writer) = &live.writer {
            self.owners.insert(writer.guid(), id);
        }
        self.live.insert(id, live);
        Ok(())
    }

    /// Makes the participant of a domain, in place of one that is not used any more if need be.
    fn join(&mut self, number: u16) -> Result<&mut Domain, String> {
        let limit = self.config.limits.domains;
        if !self.domains.contains_key(&number) && self.domains.len() >= limit {
            let used = |domain: &u16| {
                self.live.values().any(|live| live.domain == *domain)
                    || self.nodes.values().any(|node| node.domain == *domain)
            };
            let Some(unused) = self.domains.keys().copied().find(|domain| !used(domain)) else {
                return Err(format!("{limit} domains are in use, dds.limits.domains"));
            };
            self.leave(unused);
        }
        match self.domains.entry(number) {
            Entry::Occupied(domain) => Ok(domain.into_mut()),
            Entry::Vacant(place) => {
                let mut domain = Domain::new(number, &self.config)?;
                let token = Token(DOMAINS + usize::from(number));
                self.poll
                    .registry()
                    .register(&mut domain.statuses, token, Interest::READABLE)
                    .map_err(|error| format!("cannot wait for a participant: {error}"))?;
                Ok(place.insert(domain))
            }
        }
    }

    fn leave(&mut self, number: u16) {
        if let Some(mut domain) = self.domains.remove(&number) {
            drop(self.poll.registry().deregister(&mut domain.statuses));
        }
    }

    fn close(&mut self, id: Id) {
        self.readable.remove(&id);
        self.blocked.remove(&id);
        let node = self.nodes.remove(&id).map(|node| node.domain);
        let live = self.live.remove(&id);
        let number = node.or(live.as_ref().map(|live| live.domain));
        if let Some(mut live) = live {
            self.tokens.retain(|_, owner| *owner != id);
            self.owners.retain(|_, owner| *owner != id);
            if let Some(reader) = &mut live.reader {
                drop(self.poll.registry().deregister(reader));
            }
        }
        if let Some(domain) = number.and_then(|number| self.domains.get_mut(&number)) {
            domain.changed = true;
        }
    }

    /// Handles discovered and lost writers and readers.
    fn statuses(&mut self) {
        let Self {
            domains,
            live,
            owners,
            returns,
            ..
        } = self;
        let owner = |guid: &GUID| owners.get(guid).copied();
        for domain in domains.values_mut() {
            while let Some(status) = domain.statuses.try_recv_status() {
                match status {
                    Status::RemoteReaderMatched {
                        local_writer,
                        remote_reader,
                    } => {
                        if let Some(id) = owner(&local_writer)
                            && let Some(live) = live.get_mut(&id)
                        {
                            live.found(remote_reader, true);
                            returns.matched(id, live, remote_reader);
                        }
                    }
                    Status::RemoteWriterMatched {
                        local_reader,
                        remote_writer,
                    } => {
                        if let Some(id) = owner(&local_reader)
                            && let Some(live) = live.get_mut(&id)
                        {
                            live.found(remote_writer, false);
                            returns.matched(id, live, remote_writer);
                        }
                    }
                    Status::RemoteReaderQosIncompatible {
                        local_writer: mine,
                        requested_qos: asked,
                        offered_qos: offered,
                        ..
                    }
                    | Status::RemoteWriterQosIncompatible {
                        local_reader: mine,
                        requested_qos: asked,
                        offered_qos: offered,
                        ..
                    } => {
                        if let Some(live) = owner(&mine).and_then(|id| live.get_mut(&id)) {
                            let mismatch = Mismatch::between(&offered, &asked);
                            live.counts.mismatched += 1;
                            live.counts.mismatch = live.counts.mismatch.and(mismatch);
                        }
                    }
                    Status::ReaderLost { guid, .. } | Status::WriterLost { guid, .. } => {
                        live.values_mut().for_each(|live| live.lost(|g| *g == guid));
                        returns.gone(guid);
                    }
                    Status::ParticipantLost { id: prefix, reason } => {
                        let gone = |guid: &GUID| guid.prefix == prefix;
                        let silent = matches!(reason, LostReason::Timeout { .. });
                        for (id, live) in live.iter_mut() {
                            if silent {
                                returns.lost(*id, live, gone);
                            }
                            live.lost(gone);
                        }
                        if silent {
                            domain.forget_announcements();
                        }
                    }
                    Status::ParticipantDiscovered { dpd } => {
                        returns.discovered(|guid| guid.prefix == dpd.guid.prefix);
                    }
                    _ => {}
                }
            }
        }
    }

    /// Takes from the readers that may have something, a batch each.
    fn receive(&mut self) {
        let mut wake = false;
        for id in std::mem::take(&mut self.readable) {
            let Some(live) = self.live.get_mut(&id) else {
                continue;
            };
            if let Some(reader) = &live.reader {
                reader.drain_read_notifications();
            }
            let mut taken = 0;
            while taken < BATCH
                && let Some(incoming) = live.take()
            {
                taken += 1;
                wake |= self.shared.table.lock().deliver(id, incoming);
            }
            if taken == BATCH {
                self.readable.insert(id);
            }
        }
        if wake {
            self.shared.program.wake();
        }
    }

    /// Hands waiting samples to DDS.
    fn send(&mut self) {
        for (id, prepared) in std::mem::take(&mut self.blocked) {
            let Some(live) = self.live.get_mut(&id) else {
                continue;
            };
            let still = match prepared {
                Some(prepared) => live.submit(prepared).err().map(Some),
                None => None, // its sample is looked at below
            };
            match still {
                Some(still) => {
                    self.blocked.insert(id, still);
                }
                None => self.shared.table.lock().outgoing.resume(id),
            }
        }
        for _ in 0..BATCH {
            let mut table = self.shared.table.lock();
            let Some((id, outgoing)) = table.outgoing.pop() else {
                return;
            };
            let Some(live) = self.live.get_mut(&id) else {
                continue; // closed meanwhile, or never opened
            };
            if live.is_early(&outgoing) {
                // It goes back to where it was.
                table.outgoing.push_front(id, outgoing);
                table.outgoing.pause(id);
                self.blocked.insert(id, None);
                continue;
            }
            drop(table);
            let Some(prepared) = live.prepare(outgoing) else {
                continue;
            };
            if let Err(prepared) = live.submit(prepared) {
                self.shared.table.lock().outgoing.pause(id);
                self.blocked.insert(id, Some(prepared));
            }
        }
    }

    /// Hands over the counters.
    fn account(&mut self) {
        let mut changed = false;
        let mut table = self.shared.table.lock();
        for (id, live) in &mut self.live {
            let counts: Counts = std::mem::take(&mut live.counts);
            let matched = (live.matched(), live.is_served());
            changed |= table.account(*id, counts, matched);
        }
        drop(table);
        if changed {
            self.shared.program.wake();
        }
    }

    /// Tells ROS 2 about nodes where something has changed.
    fn tell(&mut self) {
        for (number, domain) in &mut self.domains {
            if !std::mem::take(&mut domain.changed) {
                continue;
            }
            let here = self.nodes.iter().filter(|(_, node)| node.domain == *number);
            let info = |(id, node): (&Id, &Node)| {
                let of_node = |live: &&OpenEndpoint| live.node == Some(*id);
                let all: Vec<&OpenEndpoint> = self.live.values().filter(of_node).collect();
                let gid = |guid: GUID| guid.to_bytes();
                let readers = all.iter().filter_map(|live| live.reader.as_ref());
                let writers = all.iter().filter_map(|live| live.writer.as_ref());
                NodeInfo {
                    name: node.name.clone(),
                    readers: readers.map(|reader| gid(reader.guid())).collect(),
                    writers: writers.map(|writer| gid(writer.guid())).collect(),
                }
            };
            let nodes: Vec<NodeInfo> = here.map(info).collect();
            domain.tell(&nodes);
        }
    }
}

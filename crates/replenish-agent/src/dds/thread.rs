//! The thread that owns DDS.
//!
//! ```text
//!   wait ──► close, open ──► datagrams in ──► matches ──► samples out ──► counters, node graph ──┐
//!    ▲        (work)         (BATCH each)     (events)    (all, in turn)                         │
//!    └───────────────────────────────────────────────────────────────────────────────────────────┘
//! ```

use super::config::DdsConfig;
use super::domain::Domain;
use super::endpoint::{Id, Node};
use super::graph::NodeInfo;
use super::open_endpoint::OpenEndpoint;
use super::prepared::Prepared;
use super::qos::Mismatch;
use super::state::{DdsEntity, SharedState};
use replenish_os::{Nanos, PollFd, WakeFd, clock, poll};
use replenish_rtps::participant::{Event, Participant, ReaderId, WriterId};
use replenish_rtps::wire::{EntityId, Guid, GuidPrefix};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Samples that are written in one go.
const BATCH: usize = 64;

/// The interval of retries for full writers and undiscovered servers.
const AGAIN: Nanos = 5_000_000;

/// The thread's own state.
pub(super) struct Engine {
    config: DdsConfig,
    shared: Arc<SharedState>,
    /// Wakes this thread.
    wake: Arc<WakeFd>,
    domains: BTreeMap<u16, Domain>,
    nodes: BTreeMap<Id, Node>,
    live: BTreeMap<Id, OpenEndpoint>,
    /// The owners of writers and readers.
    owners: HashMap<(u16, EntityId), Id>,
    /// Samples that DDS had no room for, one each; their queues are paused. `None`: waits for a
    /// server.
    blocked: BTreeMap<Id, Option<Prepared>>,
    /// Some socket may have more.
    more: bool,
    /// Bounds that were reached since the table was told.
    left_out: u64,
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
    pub(super) fn new(config: DdsConfig, shared: Arc<SharedState>, wake: Arc<WakeFd>) -> Self {
        Self {
            config,
            shared,
            wake,
            domains: BTreeMap::new(),
            nodes: BTreeMap::new(),
            live: BTreeMap::new(),
            owners: HashMap::new(),
            blocked: BTreeMap::new(),
            more: false,
            left_out: 0,
        }
    }

    pub(super) fn run(mut self) {
        let _ending = Ending(Arc::clone(&self.shared));
        while self.turn() {}
    }

    /// One round; returns whether there is another.
    fn turn(&mut self) -> bool {
        if !self.wait() {
            return false;
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
        self.receive();
        self.events();
        self.send();
        self.account();
        self.tell();
        for domain in self.domains.values_mut() {
            domain.transmit();
        }
        true
    }

    /// Waits until there is something to do; returns whether that is possible.
    fn wait(&mut self) -> bool {
        let busy = self.more || !self.shared.table.lock().outgoing.is_empty();
        let now = clock::monotonic();
        let again = if self.blocked.is_empty() {
            Nanos::MAX
        } else {
            now.saturating_add(AGAIN)
        };
        let due = self.domains.values().map(Domain::next_at);
        let due = due.min().unwrap_or(Nanos::MAX).min(again);
        let deadline = if busy {
            Some(now)
        } else {
            (due != Nanos::MAX).then_some(due)
        };
        let mut fds = vec![PollFd::readable(&*self.wake)];
        fds.extend(self.domains.values().flat_map(Domain::fds));
        let polled = poll(&mut fds, deadline);
        self.wake.clear();
        polled.is_ok()
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
        let (services, limits) = (self.config.services, self.config.limits);
        let domain = self.join(number)?;
        domain.changed = true;
        let how = (services, &limits);
        let live = OpenEndpoint::open(domain, number, endpoint.node, &endpoint.kind, how)?;
        let ends = [
            live.reader.map(ReaderId::entity),
            live.writer.map(WriterId::entity),
        ];
        for entity in ends.into_iter().flatten() {
            self.owners.insert((number, entity), id);
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
            self.domains.remove(&unused);
        }
        match self.domains.entry(number) {
            Entry::Occupied(domain) => Ok(domain.into_mut()),
            Entry::Vacant(place) => Ok(place.insert(Domain::new(number, &self.config)?)),
        }
    }

    fn close(&mut self, id: Id) {
        self.blocked.remove(&id);
        let node = self.nodes.remove(&id).map(|node| node.domain);
        let live = self.live.remove(&id);
        let number = node.or(live.as_ref().map(|live| live.domain));
        self.owners.retain(|_, owner| *owner != id);
        let Some(domain) = number.and_then(|number| self.domains.get_mut(&number)) else {
            return;
        };
        domain.changed = true;
        let (now, participant) = (clock::monotonic(), &mut domain.participant);
        if let Some(reader) = live.as_ref().and_then(|live| live.reader) {
            participant.remove_reader(reader, now);
        }
        if let Some(writer) = live.as_ref().and_then(|live| live.writer) {
            participant.remove_writer(writer, now);
        }
    }

    /// Takes in what has come, and hands the samples on.
    fn receive(&mut self) {
        let Self {
            domains,
            live,
            owners,
            shared,
            ..
        } = self;
        let mut wake = false;
        let mut more = false;
        for (number, domain) in domains {
            more |= domain.receive(|participant| {
                while let Some(reader) = participant.next_ready() {
                    let Some(sample) = participant.take(reader) else {
                        return;
                    };
                    let owner = owners.get(&(*number, reader.entity()));
                    let Some((id, live)) = owner.and_then(|id| Some((*id, live.get_mut(id)?)))
                    else {
                        continue;
                    };
                    if let Some(incoming) = live.accept(&sample) {
                        wake |= shared.table.lock().deliver(id, incoming);
                    }
                }
            });
        }
        self.more = more;
        if wake {
            self.shared.program.wake();
        }
    }

    /// Handles discovered and lost writers and readers.
    fn events(&mut self) {
        let Self {
            domains,
            live,
            owners,
            left_out,
            ..
        } = self;
        for (number, domain) in domains {
            let id = |ours: Guid| owners.get(&(*number, ours.entity)).copied();
            let mut silent: Option<GuidPrefix> = None;
            while let Some(event) = domain.event() {
                match event {
                    Event::Matched(ours, theirs) => {
                        if let Some(live) = id(ours).and_then(|id| live.get_mut(&id)) {
                            live.found(theirs);
                        }
                    }
                    Event::Silent(prefix) => silent = Some(prefix),
                    Event::ParticipantLost(_) => silent = None,
                    Event::Unmatched(ours, theirs) => {
                        if let Some(live) = id(ours).and_then(|id| live.get_mut(&id)) {
                            live.lost(theirs, silent == Some(theirs.prefix));
                        }
                    }
                    Event::Incompatible(ours, theirs, _) => {
                        let live = id(ours).and_then(|id| live.get_mut(&id));
                        let mismatch = mismatch(&domain.participant, ours, theirs);
                        if let (Some(live), Some(mismatch)) = (live, mismatch) {
                            live.counts.mismatched += 1;
                            live.mismatch = live.mismatch.and(mismatch);
                        }
                    }
                    Event::Full(_) => *left_out += 1,
                    _ => {}
                }
            }
        }
        for live in self.live.values_mut() {
            if let Some(domain) = self.domains.get(&live.domain) {
                live.look(&domain.participant);
            }
        }
    }

    /// Hands waiting samples to DDS.
    fn send(&mut self) {
        for (id, prepared) in std::mem::take(&mut self.blocked) {
            let still = match prepared {
                Some(prepared) => match self.submit(id, prepared) {
                    Ok(()) => None,
                    Err(prepared) => Some(Some(prepared)),
                },
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
            if let Err(prepared) = self.submit(id, prepared) {
                self.shared.table.lock().outgoing.pause(id);
                self.blocked.insert(id, Some(prepared));
            }
        }
    }

    fn submit(&mut self, id: Id, prepared: Prepared) -> Result<(), Prepared> {
        let Some(live) = self.live.get_mut(&id) else {
            return Ok(());
        };
        match self.domains.get_mut(&live.domain) {
            Some(domain) => live.submit(domain, prepared),
            None => Ok(()),
        }
    }

    /// Hands over the counters.
    fn account(&mut self) {
        let left_out = std::mem::take(&mut self.left_out);
        let mut changed = left_out != 0;
        let mut table = self.shared.table.lock();
        table.left_out += left_out;
        for (id, live) in &mut self.live {
            let counts = std::mem::take(&mut live.counts);
            let mismatch = std::mem::take(&mut live.mismatch);
            let matched = (live.matched(), live.is_served());
            changed |= table.account(*id, (counts, mismatch), matched);
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
                let readers = all.iter().filter_map(|live| live.reader);
                let writers = all.iter().filter_map(|live| live.writer);
                NodeInfo {
                    name: node.name.clone(),
                    readers: readers.map(ReaderId::entity).collect(),
                    writers: writers.map(WriterId::entity).collect(),
                }
            };
            let nodes: Vec<NodeInfo> = here.map(info).collect();
            domain.tell(&nodes);
        }
    }
}

/// The policies in which an own endpoint and one of others differ; `None` if either is gone.
fn mismatch(participant: &Participant, ours: Guid, theirs: Guid) -> Option<Mismatch> {
    let mut known = participant.endpoints();
    let remote = known.find(|known| known.guid == theirs)?.qos;
    let own = participant.own_qos(ours.entity)?;
    Some(if ours.entity.is_writer() {
        Mismatch::between(&own, &remote)
    } else {
        Mismatch::between(&remote, &own)
    })
}

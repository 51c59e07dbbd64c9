//! One DDS domain: a participant and its sockets, with what all endpoints in it share.

use super::config::{DdsConfig, DdsLimits, Interfaces};
use super::endpoint::Topic;
use super::graph::{self, NodeInfo};
use super::qos::{EndpointMemory, Qos};
use super::type_hashes::type_hash;
use replenish_os::{AddressChanges, PollFd, clock, hear_joined_alone, host_addresses};
use replenish_rtps::endpoint::{Body, Header, WriteError};
use replenish_rtps::participant::{
    DEFAULT_LEASE, EndpointSpec, Event, Limits, Participant, ReaderId, WriterId,
};
use replenish_rtps::ros::{GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, GidSize};
use replenish_rtps::udp::{self, Sockets, UdpConfig};
use replenish_rtps::wire::{CDR_LE, GuidPrefix, Nanos, SequenceNumber};
use std::fmt::Display;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// Participants, endpoints of others, and events of a domain.
const PARTICIPANTS: usize = 256;
const REMOTES: usize = 4096;
const EVENTS: usize = 4096;

/// Writers and readers of others that one endpoint talks with.
pub(super) const MOST_PEERS: usize = 128;

/// The most memory of a participant without its endpoints: what it knows of others, and its own
/// announcements, which it keeps for those who come late.
pub(crate) const fn domain_bytes(limits: &DdsLimits) -> usize {
    let others = PARTICIPANTS * 4096 + REMOTES * 1024 + EVENTS * 128;
    let own = (limits.endpoints + 1) * 8192 + graph::most_bytes(limits.endpoints);
    others + own + (1 << 20)
}

/// Participants on this host that are looked for without multicast.
const LOOKED_FOR: u16 = 32;

/// Datagrams of one socket that are taken before anything is sent.
const BATCH: usize = 64;

/// Bytes of a datagram: an Ethernet frame's.
const DATAGRAM: usize = 1472;

/// A participant.
pub(super) struct Domain {
    pub(super) participant: Participant,
    sockets: Sockets,
    interfaces: udp::Interfaces,
    /// Word of the host's addresses, which may change; `None` if some were chosen.
    changes: Option<AddressChanges>,
    buf: Box<[u8]>,
    /// Bytes of the longest sample.
    sample: usize,
    graph: Option<WriterId>,
    gids: GidSize,
    /// The graph has changed since its last message.
    pub(super) changed: bool,
    /// Some participant was lost: it may have forgotten the graph, and come back.
    lost_any: bool,
}

impl Domain {
    pub(super) fn new(number: u16, config: &DdsConfig) -> Result<Self, String> {
        let (v4, changes) = match &config.interfaces {
            Interfaces::Only(addresses) => (chosen(addresses), None),
            Interfaces::All => {
                let changes = AddressChanges::new().map_err(text("watch the interfaces"))?;
                (of_host()?.v4().collect(), Some(changes))
            }
        };
        let interfaces = udp::Interfaces::of(&v4, &[]);
        let loopback = interfaces.is_local();
        let peers: Vec<SocketAddr> = if loopback {
            UdpConfig::unicast(number, Ipv4Addr::LOCALHOST, LOOKED_FOR).collect()
        } else {
            Vec::new()
        };
        let udp = UdpConfig {
            domain: number,
            interfaces: &v4,
            interfaces6: &[],
            follows: changes.is_some(),
            multicast: true,
            peers: &peers,
            lease: DEFAULT_LEASE,
            enclave: "/",
            datagram: DATAGRAM,
            host_datagram: DATAGRAM,
            limits: limits(&config.limits),
        };
        let now = clock::monotonic();
        let sockets = Sockets::open(&udp).map_err(text("open the sockets of a participant"))?;
        if let ([Some(group), ..], false) = (sockets.all(), udp.follows) {
            hear_joined_alone(group).map_err(text("listen to the named interfaces alone"))?;
        }
        let participant = sockets.participant(&udp, now);
        let mut participant = participant.map_err(text("make a participant"))?;
        participant.keep_apart(); // the agent's clients reach each other in the agent
        let bytes = graph::most_bytes(config.limits.endpoints);
        let spec = EndpointSpec {
            qos: GRAPH_QOS,
            sample_bytes: bytes,
            memory: Some(bytes),
            per_participant: true,
            ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
        };
        let graph = participant.create_writer(&spec, now);
        Ok(Self {
            graph: Some(graph.map_err(text("make a writer"))?),
            participant,
            sockets,
            interfaces,
            changes,
            buf: vec![0; 1 << 16].into_boxed_slice(),
            sample: config.limits.sample,
            gids: config.gids,
            changed: false,
            lost_any: false,
        })
    }

    /// The prefix of its GUIDs.
    pub(super) fn prefix(&self) -> GuidPrefix {
        self.participant.prefix()
    }

    pub(super) fn writer(&mut self, topic: &Topic, qos: &Qos) -> Result<WriterId, String> {
        let (announced, memory) = qos.writer(self.sample);
        let spec = spec(topic, announced, memory);
        let made = self.participant.create_writer(&spec, clock::monotonic());
        made.map_err(text("make a writer"))
    }

    pub(super) fn reader(&mut self, topic: &Topic, qos: &Qos) -> Result<ReaderId, String> {
        let (announced, memory) = qos.reader(self.sample);
        let spec = spec(topic, announced, memory);
        let made = self.participant.create_reader(&spec, clock::monotonic());
        made.map_err(text("make a reader"))
    }

    /// Writes a sample and sends as much of it as may go at once.
    pub(super) fn write(
        &mut self,
        id: WriterId,
        payload: &[u8],
        header: &Header,
    ) -> Result<SequenceNumber, WriteError> {
        let now = clock::monotonic();
        let body = Body::Parts(&[&CDR_LE, payload]);
        let written = self.participant.write_with(id, body, header, now)?;
        loop {
            let room = self.buf.get_mut(..DATAGRAM).unwrap_or_default();
            let Some((len, to)) = self.participant.transmit_writer(id, room, now) else {
                return Ok(written);
            };
            let datagram = self.buf.get(..len).unwrap_or(&[]);
            self.sockets.send(datagram, to, &self.interfaces);
        }
    }

    /// The sockets to wait for.
    pub(super) fn fds(&self) -> impl Iterator<Item = PollFd<'_>> {
        let all = self.sockets.all().into_iter().flatten();
        let changes = self.changes.iter().map(PollFd::readable);
        all.map(PollFd::readable).chain(changes)
    }

    /// Takes in the datagrams that are there, a batch of each socket; `each` sees the participant
    /// after every one. Returns whether there may be more.
    pub(super) fn receive(&mut self, mut each: impl FnMut(&mut Participant)) -> bool {
        self.follow();
        let mut more = false;
        for at in 0..self.sockets.all().len() {
            let mut taken = 0;
            while taken < BATCH {
                let socket = self.sockets.all().get(at).copied().flatten();
                let Some(Ok(len)) = socket.map(|socket| socket.recv(&mut self.buf)) else {
                    break;
                };
                taken += 1;
                let datagram = self.buf.get(..len).unwrap_or(&[]);
                // A damaged one is used up to its damage; anybody can send it.
                let _damaged = self.participant.receive(datagram, clock::monotonic());
                each(&mut self.participant);
            }
            more |= taken == BATCH;
        }
        more
    }

    /// Uses the addresses that the host has now, if they have changed.
    fn follow(&mut self) {
        let changes = self.changes.as_ref();
        if !changes.is_some_and(AddressChanges::take) {
            return;
        }
        // Addresses that cannot be read now are read after the next change.
        let Some(found) = of_host().ok().filter(|found| *found != self.interfaces) else {
            return;
        };
        let now = clock::monotonic();
        let _gone_again = self.sockets.follow(&self.interfaces, &found);
        self.interfaces = found;
        self.participant.move_to(&found.at(0), now);
        while self.participant.announce_moved(now) {}
    }

    /// Sends what is due.
    pub(super) fn transmit(&mut self) {
        loop {
            let now = clock::monotonic();
            let room = self.buf.get_mut(..DATAGRAM).unwrap_or_default();
            let Some((len, to)) = self.participant.transmit(room, now) else {
                return;
            };
            let datagram = self.buf.get(..len).unwrap_or(&[]);
            self.sockets.send(datagram, to, &self.interfaces);
        }
    }

    /// When something is due at the latest.
    pub(super) fn next_at(&self) -> Nanos {
        self.participant.next_at(clock::monotonic())
    }

    /// The next event, after what it says about the graph was noted.
    pub(super) fn event(&mut self) -> Option<Event> {
        let event = self.participant.event()?;
        match event {
            Event::ParticipantLost(_) => self.lost_any = true,
            Event::ParticipantFound(_) => self.changed |= self.lost_any,
            Event::Anew(ours, _) => {
                self.changed |= self.graph.is_some_and(|own| own.entity() == ours.entity);
            }
            _ => {}
        }
        Some(event)
    }

    /// Publishes the nodes on `ros_discovery_info`.
    pub(super) fn tell(&mut self, nodes: &[NodeInfo]) {
        let message = graph::encode(self.prefix(), nodes, self.gids);
        if let (Some(graph), Some(message)) = (self.graph, message) {
            let now = clock::monotonic();
            let told = self.participant.write(graph, &message, None, now);
            debug_assert!(
                told.is_ok(),
                "the writer has room for all that there may be"
            );
        }
    }
}

impl Drop for Domain {
    /// Says goodbye, so that others need not wait for the end of the lease.
    fn drop(&mut self) {
        self.participant.leave(clock::monotonic());
        self.transmit();
    }
}

fn spec(topic: &Topic, qos: replenish_rtps::wire::Qos, memory: EndpointMemory) -> EndpointSpec<'_> {
    EndpointSpec {
        qos,
        sample_bytes: memory.sample,
        samples: memory.samples,
        memory: Some(memory.together),
        type_hash: type_hash(&topic.type_name),
        ..EndpointSpec::new(&topic.name, &topic.type_name)
    }
}

/// Bounds of a participant: others of a whole network, own endpoints as the bridge may have.
pub(super) fn limits(limits: &DdsLimits) -> Limits {
    Limits {
        participants: PARTICIPANTS,
        endpoints: REMOTES,
        own_endpoints: limits.endpoints + 1,
        matches: MOST_PEERS,
        events: EVENTS,
    }
}

/// The IPv4 addresses among those that were chosen.
fn chosen(addresses: &[IpAddr]) -> Vec<Ipv4Addr> {
    let v4 = addresses.iter().filter_map(|address| match address {
        IpAddr::V4(v4) => Some(*v4),
        IpAddr::V6(_) => None,
    });
    v4.collect()
}

/// The IPv4 addresses of this host; that of loopback if there is none.
fn of_host() -> Result<udp::Interfaces, String> {
    let mut used = udp::Interfaces::default();
    let listed = host_addresses(|ip, index| {
        if ip.is_ipv4() {
            used.add(ip, index);
        }
    });
    listed.map_err(text("list the interfaces"))?;
    if used.v4().next().is_none() {
        used.add(Ipv4Addr::LOCALHOST.into(), 0);
    }
    Ok(used)
}

fn text<E: Display>(what: &'static str) -> impl Fn(E) -> String {
    move |error| format!("cannot {what}: {error}")
}

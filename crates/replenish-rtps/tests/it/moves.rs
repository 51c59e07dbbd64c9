//! A participant whose addresses change, on a network in virtual time: its peers follow it.

use replenish_rtps::participant::{
    EndpointSpec, Event, Limits, Participant, ParticipantConfig, ReaderId, WriterId,
};
use replenish_rtps::wire::{
    CDR_LE, EndpointData, EntityId, GuidPrefix, Locators, Message, Nanos, Payload, Qos,
    SegmentName, Submessage, TypeHash,
};
use std::net::{IpAddr, SocketAddr};

const SECOND: Nanos = 1_000_000_000;
const GROUP: &str = "239.255.0.1:7400";

/// A participant with a writer of one topic and a reader of the other.
struct Node {
    ip: IpAddr,
    participant: Participant,
    writer: WriterId,
    reader: ReaderId,
}

impl Node {
    fn new(at: u8, ip: &str) -> Self {
        let ip: IpAddr = ip.parse().unwrap();
        let there = |port| -> Locators { [SocketAddr::new(ip, port)].into_iter().collect() };
        let config = ParticipantConfig {
            discovery: there(7410),
            user: there(7411),
            announce_to: &[GROUP.parse().unwrap()],
            limits: Limits::default(),
            ..ParticipantConfig::new(GuidPrefix([at + 1; 12]))
        };
        let mut participant = Participant::new(&config, 0).unwrap();
        participant.expect_moves();
        let topics = ["rt/there", "rt/back"];
        let spec = |topic: u8| EndpointSpec {
            qos: Qos::ros(),
            ..EndpointSpec::new(topics[usize::from(topic)], "std_msgs::msg::dds_::Int32_")
        };
        let own = EndpointSpec {
            unicast: there(40_000),
            ..spec(1 - at)
        };
        Self {
            ip,
            writer: participant.create_writer(&spec(at), 0).unwrap(),
            reader: participant.create_reader(&own, 0).unwrap(),
            participant,
        }
    }
}

/// Two hosts. A datagram reaches the node with its address, if both are of loopback or neither is.
struct Net {
    nodes: [Node; 2],
    now: Nanos,
    /// Datagrams to addresses that nobody has.
    astray: usize,
    ports: Vec<u16>,
    /// The second participant is announced as Fast DDS.
    strange: bool,
    /// Datagrams to groups reach nobody.
    no_multicast: bool,
}

impl Net {
    fn new(addresses: [&str; 2]) -> Self {
        let [first, second] = addresses;
        Self {
            nodes: [Node::new(0, first), Node::new(1, second)],
            now: 1,
            astray: 0,
            ports: Vec::new(),
            strange: false,
            no_multicast: false,
        }
    }

    fn run(&mut self, time: Nanos) {
        let end = self.now + time;
        while self.now < end {
            while self.exchange() {}
            let mut next = self
                .nodes
                .iter()
                .map(|node| node.participant.next_at(self.now));
            let first = next.next().unwrap().min(next.next().unwrap());
            self.now = first.clamp(self.now + 1, end);
        }
    }

    fn exchange(&mut self) -> bool {
        let (mut any, mut buf) = (false, [0; 1472]);
        for from in [0, 1] {
            while let Some((len, to)) = self.nodes[from].participant.transmit(&mut buf, self.now) {
                any = true;
                if from == 1 && self.strange {
                    disguise(&mut buf[..len]);
                }
                let (sender, peer) = (self.nodes[from].ip, &mut self.nodes[1 - from]);
                let group = to == GROUP.parse().unwrap();
                if group && self.no_multicast {
                    continue;
                }
                let joined = sender.is_loopback() == peer.ip.is_loopback();
                if joined && (group || to.ip() == peer.ip) {
                    self.ports.push(to.port());
                    peer.participant.receive(&buf[..len], self.now).unwrap();
                } else {
                    self.astray += 1;
                }
            }
        }
        any
    }

    fn moves(&mut self, at: usize, to: &str) {
        let node = &mut self.nodes[at];
        node.ip = to.parse().unwrap();
        let there = [SocketAddr::new(node.ip, 0)].into_iter().collect();
        node.participant.move_to(&there, self.now);
        while node.participant.announce_moved(self.now) {}
    }

    /// Numbers both ways, all of which come once and in order within `time`.
    fn numbers(&mut self, from: u8, time: Nanos) {
        for number in from..from + 3 {
            for node in &mut self.nodes {
                let sample = [&CDR_LE[..], &[number, 0, 0, 0]].concat();
                let written = node.participant.write(node.writer, &sample, None, self.now);
                written.unwrap();
            }
        }
        self.run(time);
        for node in &mut self.nodes {
            let next = || {
                node.participant
                    .take(node.reader)
                    .map(|sample| sample.payload[4])
            };
            let got: Vec<u8> = std::iter::from_fn(next).collect();
            assert_eq!(got, [from, from + 1, from + 2], "at {}", node.ip);
        }
    }
}

#[test]
fn samples_go_on_where_the_peer_has_gone() {
    let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
    net.run(SECOND);
    net.numbers(1, SECOND);
    net.moves(0, "10.0.0.7");
    // Samples that are written before the peer has heard of the move are repaired.
    net.numbers(4, 10 * SECOND);
    net.moves(1, "10.0.0.8");
    net.run(SECOND);
    net.moves(0, "10.0.0.9");
    net.numbers(7, 10 * SECOND);
    (net.astray, net.ports) = (0, Vec::new());
    net.numbers(10, 10 * SECOND);
    assert_eq!(net.astray, 0);
    // Readers keep their ports, and discovery and answers theirs.
    net.ports.sort_unstable();
    net.ports.dedup();
    assert_eq!(net.ports, [7400, 7410, 7411, 40_000]);
}

#[test]
fn who_starts_before_the_network_is_found_when_it_is_there() {
    let mut net = Net::new(["127.0.0.1", "10.0.0.2"]);
    net.run(30 * SECOND);
    net.moves(0, "10.0.0.1");
    net.run(SECOND);
    net.numbers(1, SECOND);
}

/// Writes Fast DDS's name into the vendor's parameter of an announcement.
fn disguise(datagram: &mut [u8]) {
    const VENDOR: [u8; 4] = [0x16, 0, 4, 0];
    let found = datagram.windows(4).position(|bytes| bytes == VENDOR);
    if let Some(at) = found {
        datagram[at + 4..at + 6].copy_from_slice(&[1, 0x0f]);
    }
}

/// It hears a goodbye, and finds the participant again where it has gone: by the address that it is
/// still announced to, if there is no other way.
#[test]
fn who_keeps_the_first_address_meets_the_participant_anew() {
    for no_multicast in [false, true] {
        let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
        net.strange = true;
        net.run(SECOND);
        net.numbers(1, SECOND);
        net.no_multicast = no_multicast;
        for (to, from) in [("10.0.0.7", 4), ("10.0.0.8", 7)] {
            while net.nodes[1].participant.event().is_some() {}
            // One change is several to the kernel, with no way in between.
            for step in ["127.0.0.1", to, "127.0.0.1", to] {
                net.moves(0, step);
                while net.exchange() {}
            }
            net.run(SECOND);
            let events = std::iter::from_fn(|| net.nodes[1].participant.event());
            let (mut lost, mut found) = (0, 0);
            for event in events {
                lost += usize::from(matches!(event, Event::ParticipantLost(_)));
                found += usize::from(matches!(event, Event::ParticipantFound(_)));
            }
            assert!(lost > 0 && found == lost, "{lost} {found}");
            net.numbers(from, SECOND);
        }
    }
}

/// An address that comes besides takes nothing from a peer, nor does a network that goes and comes
/// back as it was.
#[test]
fn while_the_old_address_stays_nobody_hears_a_goodbye() {
    let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
    net.strange = true;
    net.run(SECOND);
    while net.nodes[1].participant.event().is_some() {}
    let more = ["10.0.0.1", "172.17.0.1"].map(|ip| SocketAddr::new(ip.parse().unwrap(), 0));
    let now = net.now;
    net.nodes[0]
        .participant
        .move_to(&more.into_iter().collect(), now);
    while net.nodes[0].participant.announce_moved(now) {}
    net.run(SECOND);
    net.numbers(1, SECOND);
    net.moves(0, "127.0.0.1");
    net.run(SECOND);
    let node = &mut net.nodes[0];
    node.ip = "10.0.0.1".parse().unwrap();
    node.participant
        .move_to(&more.into_iter().collect(), net.now);
    while node.participant.announce_moved(net.now) {}
    net.numbers(4, 10 * SECOND);
    let events = std::iter::from_fn(|| net.nodes[1].participant.event());
    let gone = |event: Event| matches!(event, Event::ParticipantLost(_));
    assert_eq!(events.filter(|event| gone(*event)).count(), 0);
}

/// Announcements of endpoints with the longest names have room for all addresses.
#[test]
fn the_longest_endpoints_are_announced_with_four_addresses() {
    let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
    let long = "n".repeat(255);
    let spec = EndpointSpec {
        type_hash: Some(TypeHash([7; 32])),
        segment: Some(SegmentName([9; 16])),
        qos: Qos {
            depth: 7,
            deadline: SECOND,
            lifespan: SECOND,
            liveliness_lease: SECOND,
            ..Qos::latched(7)
        },
        ..EndpointSpec::new(&long, &long)
    };
    let node = &mut net.nodes[0].participant;
    node.create_writer(&spec, 0).unwrap();
    node.create_reader(&spec, 0).unwrap();
    net.run(SECOND);
    let four = [1, 3, 4, 5].map(|last| SocketAddr::from(([10, 0, 0, last], 0)));
    let (now, node) = (net.now, &mut net.nodes[0].participant);
    node.move_to(&four.into_iter().collect(), now);
    while node.announce_moved(now) {}
    let (mut addresses, mut buf) = (Vec::new(), [0; 1472]);
    while let Some((len, _)) = node.transmit(&mut buf, now) {
        for part in Message::decode(&buf[..len]).unwrap().submessages() {
            let Ok(Submessage::Data(data)) = part else {
                continue;
            };
            let sedp = data.writer != EntityId::SPDP_WRITER;
            if let (true, Payload::Data(payload)) = (sedp, data.payload) {
                let endpoint = EndpointData::decode(payload).unwrap();
                addresses.push(endpoint.unicast.iter().count());
            }
        }
    }
    assert_eq!(addresses, [4; 4]);
}

#[test]
fn without_an_address_nothing_changes() {
    let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
    net.run(SECOND);
    let now = net.now;
    net.nodes[0].participant.move_to(&Locators::NONE, now);
    assert!(!net.nodes[0].participant.announce_moved(now));
    net.numbers(1, SECOND);
    assert_eq!(net.astray, 0);
}

/// Both are on one host, and its network goes and comes.
#[test]
fn programs_of_one_host_keep_each_other_through_a_loss_of_the_network() {
    let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
    net.run(SECOND);
    net.numbers(1, SECOND);
    net.moves(0, "127.0.0.1");
    net.moves(1, "127.0.0.2");
    net.numbers(4, 10 * SECOND);
    net.moves(1, "10.0.0.2");
    net.moves(0, "10.0.0.1");
    net.numbers(7, 10 * SECOND);
}

/// It is in the old place still, and the way to it is not open for a while: it would never know.
#[test]
fn who_missed_the_goodbyes_hears_them_again() {
    let mut net = Net::new(["10.0.0.1", "10.0.0.2"]);
    net.strange = true;
    net.run(SECOND);
    net.numbers(1, SECOND);
    while net.nodes[1].participant.event().is_some() {}
    net.moves(0, "10.0.0.7");
    let (closed, end) = (net.now + SECOND, net.now + 40 * SECOND);
    let (mut buf, mut told) = ([0; 1472], false);
    while net.now < end {
        while let Some((len, _)) = net.nodes[0].participant.transmit(&mut buf, net.now) {
            if net.now > closed {
                let peer = &mut net.nodes[1].participant;
                peer.receive(&buf[..len], net.now).unwrap();
            }
        }
        let events = std::iter::from_fn(|| net.nodes[1].participant.event());
        told |= events.fold(false, |any, e| any | matches!(e, Event::ParticipantLost(_)));
        while let Some((len, to)) = net.nodes[1].participant.transmit(&mut buf, net.now) {
            disguise(&mut buf[..len]);
            // It keeps the first address until it hears that the participant is gone.
            if told || to == GROUP.parse().unwrap() {
                let peer = &mut net.nodes[0].participant;
                peer.receive(&buf[..len], net.now).unwrap();
            }
        }
        net.now += 1_000_000;
    }
    assert!(told, "it heard a goodbye");
    net.numbers(4, 10 * SECOND);
}

/// Announcements of the participant follow quickly, however many peers were said goodbye to.
#[test]
fn each_of_five_peers_is_announced_to_soon_after_its_goodbye() {
    let mut node = Node::new(0, "10.0.0.1").participant;
    let mut buf = [0; 1472];
    for at in 1..=5 {
        let mut peer = Node::new(at % 2, &format!("10.0.0.{}", 10 + at)).participant;
        while let Some((len, _)) = peer.transmit(&mut buf, 1) {
            buf[8..20].fill(100 + at); // the prefix of the message
            let mut datagram = buf[..len].to_vec();
            disguise(&mut datagram);
            rename(&mut datagram, (at % 2) + 1, 100 + at);
            node.receive(&datagram, 1).ok();
        }
    }
    assert_eq!(node.participants().count(), 5);
    let mut now = 1;
    let mut sends = |node: &mut Participant, now| {
        let mut sent = Vec::new();
        while let Some((len, to)) = node.transmit(&mut buf, now) {
            for part in Message::decode(&buf[..len]).unwrap().submessages() {
                if let Ok(Submessage::Data(data)) = part
                    && data.writer == EntityId::SPDP_WRITER
                {
                    sent.push((to, matches!(data.payload, Payload::Key(_))));
                }
            }
        }
        sent
    };
    while now < SECOND {
        sends(&mut node, now);
        now += 1_000_000;
    }
    let there = [SocketAddr::new("10.0.0.7".parse().unwrap(), 0)];
    node.move_to(&there.into_iter().collect(), now);
    let mut times = std::collections::BTreeMap::new();
    let begin = now;
    while now < begin + 4 * SECOND {
        for (to, is_goodbye) in sends(&mut node, now) {
            let (said, after) = times.entry(to).or_insert((0, 0));
            if is_goodbye {
                (*said, *after) = (now, 0);
            } else if *after == 0 {
                *after = now;
            }
        }
        now += 1_000_000;
    }
    times.remove(&GROUP.parse().unwrap());
    assert_eq!(times.len(), 5);
    for (to, (said, after)) in times {
        assert!(
            said > 0 && after > said && after < said + 300 * 1_000_000,
            "{to}: {said} {after}"
        );
    }
}

/// Gives the participant of an announcement another prefix.
fn rename(datagram: &mut [u8], from: u8, to: u8) {
    let mut at = 0;
    while at + 12 <= datagram.len() {
        if datagram[at..at + 12] == [from; 12] {
            datagram[at..at + 12].fill(to);
        }
        at += 1;
    }
}

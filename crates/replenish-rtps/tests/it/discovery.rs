//! Participants on a network in virtual time: who finds whom, what is matched, what ends it.

use replenish_rtps::participant::{
    Bound, ConfigError, EndpointSpec, Event, Limits, Part, Participant, ParticipantConfig, Policy,
    ReaderId, WriterId,
};
use replenish_rtps::wire::{
    CDR_LE, EntityId, GuidPrefix, INFINITE, LivelinessKind, Locators, Message, Nanos, Qos,
    Reliability, Submessage, TypeHash,
};
use std::net::SocketAddr;

const SECOND: Nanos = 1_000_000_000;
const GROUP: &str = "239.255.0.1:7400";

/// Participants that hear each other's datagrams at once, but for `loss` of a hundred.
struct Net {
    nodes: Vec<(SocketAddr, Participant)>,
    now: Nanos,
    loss: u64,
    dice: u64,
}

fn address(at: usize) -> SocketAddr {
    format!("127.0.0.1:{}", 8000 + at).parse().unwrap()
}

impl Net {
    fn new(count: usize, limits: Limits) -> Self {
        let mut net = Net {
            nodes: Vec::new(),
            now: 1,
            loss: 0,
            dice: 88_172_645_463_325_252,
        };
        for _ in 0..count {
            net.join(limits);
        }
        net
    }

    fn join(&mut self, limits: Limits) -> usize {
        self.join_with(limits, true)
    }

    fn join_with(&mut self, limits: Limits, whole_graph: bool) -> usize {
        let at = self.nodes.len();
        let config = ParticipantConfig {
            discovery: [address(at)].into_iter().collect(),
            user: [address(at)].into_iter().collect(),
            announce_to: &[GROUP.parse().unwrap()],
            limits,
            whole_graph,
            ..ParticipantConfig::new(GuidPrefix([at as u8 + 1; 12]))
        };
        let participant = Participant::new(&config, self.now).unwrap();
        self.nodes.push((address(at), participant));
        at
    }

    fn node(&mut self, at: usize) -> &mut Participant {
        &mut self.nodes[at].1
    }

    fn run(&mut self, time: Nanos) {
        let end = self.now + time;
        while self.now < end {
            while self.exchange() {}
            let next = self.nodes.iter().map(|(_, node)| node.next_at(self.now));
            self.now = next.min().unwrap_or(end).clamp(self.now + 1, end);
        }
    }

    /// Whether any participant sent anything.
    fn exchange(&mut self) -> bool {
        let mut mail = Vec::new();
        let mut buf = [0; 1472];
        for (from, node) in &mut self.nodes {
            while let Some((len, to)) = node.transmit(&mut buf, self.now) {
                mail.push((*from, to, buf[..len].to_vec()));
            }
        }
        let any = !mail.is_empty();
        for (from, to, bytes) in mail {
            for (address, node) in &mut self.nodes {
                let group = to == GROUP.parse().unwrap();
                self.dice ^= self.dice << 13;
                self.dice ^= self.dice >> 7;
                self.dice ^= self.dice << 17;
                if self.dice % 100 >= self.loss && (*address == to || group && *address != from) {
                    node.receive(&bytes, self.now).unwrap();
                }
            }
        }
        any
    }

    fn events(&mut self, at: usize) -> Vec<Event> {
        let node = self.node(at);
        std::iter::from_fn(|| node.event()).collect()
    }

    fn writer(&mut self, at: usize, qos: Qos) -> WriterId {
        let now = self.now;
        self.node(at).create_writer(&spec(qos), now).unwrap()
    }

    fn reader(&mut self, at: usize, qos: Qos) -> ReaderId {
        let now = self.now;
        self.node(at).create_reader(&spec(qos), now).unwrap()
    }
}

fn spec(qos: Qos) -> EndpointSpec<'static> {
    EndpointSpec {
        qos,
        type_hash: Some(TypeHash([7; 32])),
        sample_bytes: 64,
        ..EndpointSpec::new("rt/chatter", "std_msgs::msg::dds_::Int32_")
    }
}

fn sample(number: u32) -> Vec<u8> {
    [CDR_LE, number.to_le_bytes()].concat()
}

#[test]
fn two_participants_find_each_other_and_exchange_samples() {
    for loss in [0, 15, 40] {
        let mut net = Net::new(2, Limits::default());
        net.loss = loss;
        let writer = net.writer(0, Qos::ros());
        let reader = net.reader(1, Qos::ros());
        net.run(10 * SECOND);
        assert_eq!(
            net.node(0).writer(writer).unwrap().matched(),
            1,
            "loss {loss}"
        );
        assert_eq!(net.node(1).reader(reader).unwrap().matched(), 1);
        let seen = net.node(1).endpoints().next().unwrap();
        assert_eq!(
            (seen.topic(), seen.type_name()),
            ("rt/chatter", "std_msgs::msg::dds_::Int32_")
        );
        assert_eq!(
            (seen.type_hash, seen.qos.reliability),
            (Some(TypeHash([7; 32])), Reliability::Reliable)
        );
        for number in 0..50 {
            let now = net.now;
            net.node(0)
                .write(writer, &sample(number), None, now)
                .unwrap();
            net.run(20 * SECOND); // at 40 % loss one of 140 takes more than 5 s
            let got = net
                .node(1)
                .take(reader)
                .map(|sample| sample.payload.to_vec());
            assert_eq!(got, Some(sample(number)), "loss {loss}, {number}");
        }
        assert!(net.node(1).take(reader).is_none());
    }
}

/// Fast DDS announces itself before it listens: the answer to its first announcement is lost.
#[test]
fn a_participant_that_did_not_hear_the_answer_is_answered_again() {
    let mut net = Net::new(1, Limits::default());
    net.run(2 * SECOND); // its own quick announcements are over
    let late = net.join(Limits::default());
    let begin = net.now;
    let group = GROUP.parse().unwrap();
    let mut buf = [0; 1472];
    while net.now < begin + SECOND {
        let now = net.now;
        while let Some((len, to)) = net.node(late).transmit(&mut buf, now) {
            if to == group || to == address(0) {
                net.node(0).receive(&buf[..len], now).unwrap();
            }
        }
        while let Some((len, to)) = net.node(0).transmit(&mut buf, now) {
            let listens = now > begin + 150_000_000;
            if listens && (to == group || to == address(late)) {
                net.node(late).receive(&buf[..len], now).unwrap();
            }
        }
        net.now += 1_000_000;
    }
    let found = |events: Vec<Event>| {
        let is = |event: &Event| matches!(event, Event::ParticipantFound(_));
        events.iter().filter(|event| is(event)).count()
    };
    assert_eq!((found(net.events(0)), found(net.events(late))), (1, 1));
}

#[test]
fn a_participant_that_leaves_is_gone_at_once_and_a_silent_one_after_its_lease() {
    let mut net = Net::new(3, Limits::default());
    net.writer(1, Qos::ros());
    net.writer(2, Qos::ros());
    let reader = net.reader(0, Qos::ros());
    net.run(2 * SECOND);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 2);
    let now = net.now;
    net.node(1).leave(now);
    net.run(SECOND / 100);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 1);
    // Participant 2 falls silent: 20 s of lease, counted from its last announcement.
    let gone = net.nodes.pop().unwrap();
    net.run(16 * SECOND);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 1);
    net.run(5 * SECOND);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 0);
    let lost = net
        .events(0)
        .into_iter()
        .filter(|e| matches!(e, Event::ParticipantLost(_)));
    assert_eq!(lost.count(), 2);
    // It speaks again after a pause longer than its lease, as it was.
    net.nodes.push(gone);
    net.run(8 * SECOND);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 1);
}

#[test]
fn an_endpoint_that_is_removed_is_unmatched() {
    let mut net = Net::new(2, Limits::default());
    let reader = net.reader(1, Qos::ros());
    // More than the history of discovery has places: what lives must stay announced.
    let first = net.writer(0, Qos::ros());
    for _ in 0..300 {
        let writer = net.writer(0, Qos::ros());
        net.run(SECOND / 50);
        assert_eq!(net.node(1).reader(reader).unwrap().matched(), 2);
        let now = net.now;
        net.node(0).remove_writer(writer, now);
        net.run(SECOND / 50);
        assert_eq!(net.node(1).reader(reader).unwrap().matched(), 1);
    }
    assert_eq!(net.node(0).writer(first).unwrap().matched(), 1);
    let late = net.join(Limits::default());
    net.run(2 * SECOND);
    assert_eq!(net.node(late).endpoints().count(), 2);
}

#[test]
fn endpoints_that_do_not_fit_say_why() {
    let ros = Qos::ros();
    let best_effort = Qos {
        reliability: Reliability::BestEffort,
        ..ros
    };
    let lease = Qos {
        liveliness_lease: SECOND,
        ..ros
    };
    let cases = [
        (best_effort, ros, Policy::Reliability),
        (ros, Qos::latched(1), Policy::Durability),
        (
            ros,
            Qos {
                deadline: SECOND,
                ..ros
            },
            Policy::Deadline,
        ),
        (ros, lease, Policy::Liveliness),
        (
            Qos {
                liveliness: LivelinessKind::ManualByTopic,
                ..ros
            },
            lease,
            Policy::Liveliness,
        ),
        (
            ros,
            Qos {
                exclusive: true,
                ..ros
            },
            Policy::Ownership,
        ),
        (
            ros,
            Qos {
                by_source_time: true,
                ..ros
            },
            Policy::DestinationOrder,
        ),
    ];
    for (offered, requested, why) in cases {
        let mut net = Net::new(2, Limits::default());
        let writer = net.writer(0, offered);
        let reader = net.reader(1, requested);
        net.run(2 * SECOND);
        assert_eq!(net.node(0).writer(writer).unwrap().matched(), 0, "{why:?}");
        assert_eq!(net.node(1).reader(reader).unwrap().matched(), 0);
        let is =
            |event: &Event| matches!(event, Event::Incompatible(_, _, policy) if *policy == why);
        // Said once, however often they are announced and wherever they are reached.
        for at in 0..2 {
            let (now, there) = (net.now, [address(at)].into_iter().collect());
            net.node(at).move_to(&there, now);
            while net.node(at).announce_moved(now) {}
        }
        net.run(2 * SECOND);
        for at in 0..2 {
            let said = net.events(at).iter().filter(|event| is(event)).count();
            assert_eq!(said, 1, "{why:?}");
        }
        let statuses = [
            net.node(0).writer_status(writer).unwrap(),
            net.node(1).reader_status(reader).unwrap(),
        ];
        assert_eq!(statuses.map(|status| status.incompatible), [1, 1]);
    }
    // More is offered than requested.
    for (offered, requested) in [
        (Qos::latched(3), best_effort),
        (
            Qos {
                deadline: SECOND,
                ..ros
            },
            Qos {
                deadline: INFINITE,
                ..ros
            },
        ),
        (lease, ros),
    ] {
        let mut net = Net::new(2, Limits::default());
        let writer = net.writer(0, offered);
        net.reader(1, requested);
        net.run(2 * SECOND);
        assert_eq!(net.node(0).writer(writer).unwrap().matched(), 1);
    }
}

#[test]
fn bounds_are_kept_and_reported() {
    let small = Limits {
        participants: 1,
        endpoints: 2,
        own_endpoints: 4,
        matches: 1,
        events: 16,
    };
    let mut net = Net::new(1, small);
    for _ in 0..2 {
        net.join(Limits::default());
    }
    let reader = net.reader(0, Qos::ros());
    for _ in 0..4 {
        net.writer(1, Qos::ros());
        net.writer(2, Qos::ros());
    }
    net.run(SECOND);
    assert_eq!(net.node(0).participants().count(), 1);
    assert_eq!(net.node(0).endpoints().count(), 2);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 1);
    let events = net.events(0);
    assert!(events.len() <= 16);
    net.run(4 * SECOND);
    let events = [events, net.events(0)].concat();
    for bound in [Bound::Participants, Bound::Events] {
        assert!(events.contains(&Event::Full(bound)), "{bound:?} {events:?}");
    }
    for _ in 0..3 {
        net.reader(0, Qos::ros());
    }
    let full = net.node(0).create_reader(&spec(Qos::ros()), 0);
    assert_eq!(full.unwrap_err(), ConfigError::Full);
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let config = ParticipantConfig {
        domain: 233,
        ..ParticipantConfig::new(GuidPrefix([1; 12]))
    };
    let error = Participant::new(&config, 0).unwrap_err();
    assert_eq!(error.to_string(), "domain = 233 is not allowed: 0 to 232");
    let mut net = Net::new(1, Limits::default());
    let spec = EndpointSpec {
        sample_bytes: 3,
        ..spec(Qos::ros())
    };
    let error = net.node(0).create_writer(&spec, 0).unwrap_err();
    assert_eq!(
        error.to_string(),
        "sample_bytes = 3 is not allowed: 4 to 536870912"
    );
}

#[test]
fn own_endpoints_of_one_topic_hear_each_other() {
    let mut net = Net::new(1, Limits::default());
    let (writer, reader) = (net.writer(0, Qos::ros()), net.reader(0, Qos::ros()));
    let now = net.now;
    let node = net.node(0);
    assert_eq!(node.writer(writer).unwrap().matched(), 1);
    node.write(writer, &sample(7), None, now).unwrap();
    net.run(SECOND);
    let node = net.node(0);
    assert_eq!(node.take(reader).map(|sample| sample.sn), Some(1));
    assert!(node.take(reader).is_none(), "once");
    assert!(node.writer(writer).unwrap().is_acknowledged());
    assert_eq!(node.endpoints().count(), 0, "others have none");
    node.remove_reader(reader, now);
    assert_eq!(node.writer(writer).unwrap().matched(), 0);
}

/// As a microcontroller has it: many endpoints of other topics take none of its few places.
#[test]
fn a_small_participant_keeps_the_endpoints_of_its_own_topics_alone() {
    let mut net = Net::new(1, Limits::default());
    for number in 0..20 {
        let topic = format!("rt/other{number}");
        let other = EndpointSpec::new(&topic, "std_msgs::msg::dds_::Int32_");
        let now = net.now;
        net.node(0).create_writer(&other, now).unwrap();
        net.node(0).create_reader(&other, now).unwrap();
    }
    net.reader(0, Qos::ros());
    let limits = Limits {
        endpoints: 1,
        ..Limits::default()
    };
    let small = net.join_with(limits, false);
    let writer = net.writer(small, Qos::ros());
    net.run(SECOND);
    assert_eq!(net.node(small).writer(writer).unwrap().matched(), 1);
    assert_eq!(net.node(small).endpoints().count(), 1);
    let full = |event: &Event| matches!(event, Event::Full(_));
    assert!(!net.events(small).iter().any(full));
}

/// A caller without time for discovery sends samples all the same, and discovery when it has time
/// again: nothing of it is lost.
#[test]
fn samples_do_not_wait_for_discovery() {
    let mut net = Net::new(2, Limits::default());
    let writer = net.writer(0, Qos::ros());
    let reader = net.reader(1, Qos::ros());
    net.run(SECOND);
    let (to, now) = (address(1), net.now);
    let another = EndpointSpec {
        type_hash: None,
        ..EndpointSpec::new("rt/other", "std_msgs::msg::dds_::Int32_")
    };
    let announced = net.node(0).create_writer(&another, now).unwrap();
    net.node(0).write(writer, &sample(3), None, now).unwrap();
    assert!(net.node(0).part_next_at(Part::Discovery, now) <= now);
    assert!(net.node(0).part_next_at(Part::Samples, now) <= now);
    let mut buf = [0; 1472];
    while let Some((len, at)) = net.node(0).transmit_part(Part::Samples, &mut buf, now) {
        assert_eq!(at, to);
        net.node(1).receive(&buf[..len], now).unwrap();
    }
    let taken = net.node(1).take(reader).map(|s| s.payload.to_vec());
    assert_eq!(taken, Some(sample(3)));
    assert!(net.node(0).part_next_at(Part::Samples, now) > now);
    assert!(net.node(0).part_next_at(Part::Discovery, now) <= now);
    let knows = |net: &mut Net| {
        let mut known = net.node(1).endpoints();
        known.any(|end| end.guid.entity == announced.entity())
    };
    assert!(!knows(&mut net));
    while let Some((len, _)) = net.node(0).transmit_part(Part::Discovery, &mut buf, now) {
        net.node(1).receive(&buf[..len], now).unwrap();
    }
    assert!(knows(&mut net));
    // The answer is due, which is now and not in the past.
    assert_eq!(net.node(1).part_next_at(Part::Discovery, now), now);
}

/// A caller without time for repairs sends new samples all the same, and repairs when it has time
/// again; until then no heartbeat has them asked for once more.
#[test]
fn samples_do_not_wait_for_repairs() {
    let mut net = Net::new(2, Limits::default());
    let writer = net.writer(0, Qos::ros());
    let reader = net.reader(1, Qos::ros());
    net.run(SECOND);
    let mut buf = [0; 1472];
    let now = net.now;
    let write = |net: &mut Net, number| {
        net.node(0)
            .write(writer, &sample(number), None, now)
            .unwrap();
    };
    // The first sample is lost, and the second one tells of it.
    write(&mut net, 1);
    while net.node(0).transmit(&mut buf, now).is_some() {}
    write(&mut net, 2);
    net.now += 10_000_000;
    let now = net.now;
    let mut deliver = |net: &mut Net, part| {
        let mut count = 0;
        while let Some((len, _)) = net.node(0).transmit_part(part, &mut buf, now) {
            net.node(1).receive(&buf[..len], now).unwrap();
            count += 1;
        }
        count
    };
    assert_eq!(deliver(&mut net, Part::Repairs), 0);
    assert_eq!(deliver(&mut net, Part::Samples), 1);
    let mut answer = [0; 1472];
    while let Some((len, _)) = net.node(1).transmit(&mut answer, now) {
        net.node(0).receive(&answer[..len], now).unwrap();
    }
    assert_eq!(net.node(0).part_next_at(Part::Repairs, now), now);
    assert!(net.node(0).part_next_at(Part::Samples, now) > now);
    net.node(0).write(writer, &sample(3), None, now).unwrap();
    assert_eq!(deliver(&mut net, Part::Samples), 1);
    assert!(net.node(1).take(reader).is_none(), "the first is missing");
    assert_eq!(deliver(&mut net, Part::Samples), 0);
    let heartbeat = now + 20_000_000;
    let sent = net
        .node(0)
        .transmit_part(Part::Samples, &mut answer, heartbeat);
    assert!(sent.is_none(), "a heartbeat asks for what is asked for");
    assert_eq!(deliver(&mut net, Part::Repairs), 1);
    for number in 1..=3 {
        let taken = net.node(1).take(reader).map(|s| s.payload.to_vec());
        assert_eq!(taken, Some(sample(number)));
    }
    assert!(net.node(0).part_next_at(Part::Repairs, now) > now);
}

/// Nothing goes to a participant that has said goodbye, nor does its request wait for ever: a
/// dispatcher without time for repairs would look for it again and again.
#[test]
fn a_reader_that_leaves_takes_its_requests_along() {
    let mut net = Net::new(2, Limits::default());
    let writer = net.writer(0, Qos::ros());
    net.reader(1, Qos::ros());
    net.run(SECOND);
    let mut buf = [0; 1472];
    let write = |net: &mut Net, number| {
        let now = net.now;
        net.node(0)
            .write(writer, &sample(number), None, now)
            .unwrap();
    };
    write(&mut net, 1);
    let now = net.now;
    while net.node(0).transmit(&mut buf, now).is_some() {} // it is lost
    write(&mut net, 2);
    net.now += 10_000_000;
    let now = net.now;
    while let Some((len, _)) = net.node(0).transmit_part(Part::Samples, &mut buf, now) {
        net.node(1).receive(&buf[..len], now).unwrap();
    }
    while let Some((len, _)) = net.node(1).transmit(&mut buf, now) {
        net.node(0).receive(&buf[..len], now).unwrap();
    }
    assert_eq!(net.node(0).part_next_at(Part::Repairs, now), now);
    net.node(1).leave(now);
    while let Some((len, _)) = net.node(1).transmit(&mut buf, now) {
        net.node(0).receive(&buf[..len], now).unwrap();
    }
    let far = now + 60 * SECOND;
    assert!(net.node(0).part_next_at(Part::Repairs, now) > far);
    let later = now + 20_000_000; // the heartbeat that was planned for it
    for part in [Part::Repairs, Part::Samples] {
        assert!(net.node(0).transmit_part(part, &mut buf, later).is_none());
        assert!(net.node(0).part_next_at(part, later) > far);
    }
}

/// Announcements are lost, in a flood of others' for example, but samples come: their participant
/// is alive. It is gone a lease after the last of them.
#[test]
fn a_participant_that_sends_samples_is_not_taken_for_gone() {
    let mut net = Net::new(2, Limits::default());
    let writer = net.writer(0, Qos::ros());
    let reader = net.reader(1, Qos::ros());
    net.run(SECOND);
    net.events(1);
    let mut buf = [0; 1472];
    for number in 0..100 {
        net.now += SECOND;
        let now = net.now;
        net.node(0)
            .write(writer, &sample(number), None, now)
            .unwrap();
        while let Some((len, _)) = net.node(0).transmit_part(Part::Samples, &mut buf, now) {
            net.node(1).receive(&buf[..len], now).unwrap();
        }
        while let Some((len, _)) = net.node(1).transmit(&mut buf, now) {
            net.node(0).receive(&buf[..len], now).unwrap();
        }
        assert!(net.node(1).take(reader).is_some(), "sample {number}");
    }
    let lost = |event: &Event| matches!(event, Event::Silent(_) | Event::ParticipantLost(_));
    assert!(!net.events(1).iter().any(lost));
    let lease = 20 * SECOND;
    for (later, gone) in [(lease - 3 * SECOND, false), (3 * SECOND, true)] {
        net.now += later;
        let now = net.now;
        while net.node(1).transmit(&mut buf, now).is_some() {}
        assert_eq!(net.events(1).iter().any(lost), gone);
    }
}

/// Only one of the two has lost the other, and what it is told then gets lost once.
#[test]
fn who_begins_anew_is_told_until_it_has_everything() {
    let mut net = Net::new(2, Limits::default());
    net.writer(0, Qos::ros());
    let reader = net.reader(1, Qos::ros());
    net.run(SECOND);
    // Nothing comes from the first for longer than its lease.
    let (deaf, mut lost, mut buf) = (net.now + 21 * SECOND, false, [0; 1472]);
    while net.now < deaf + 30 * SECOND {
        let now = net.now;
        while let Some((len, _)) = net.node(0).transmit(&mut buf, now) {
            let mut parts = Message::decode(&buf[..len]).unwrap().submessages();
            let announces = parts.any(|part| match part {
                Ok(Submessage::Data(data)) => data.writer == EntityId::SEDP_PUBLICATIONS_WRITER,
                _ => false,
            });
            if now < deaf {
                continue;
            }
            if announces && !lost {
                lost = true;
                continue;
            }
            net.node(1).receive(&buf[..len], now).unwrap();
        }
        while let Some((len, _)) = net.node(1).transmit(&mut buf, now) {
            net.node(0).receive(&buf[..len], now).unwrap();
        }
        net.now += 1_000_000;
    }
    assert!(lost, "an announcement was repeated");
    assert_eq!(net.node(1).reader(reader).unwrap().matched(), 1);
}

/// Fast DDS and Cyclone ignore counts that are not higher than those before.
#[test]
fn counts_of_answers_go_on_after_a_loss() {
    let mut net = Net::new(2, Limits::default());
    net.writer(0, Qos::ros());
    let (deaf, end) = (net.now + SECOND, net.now + 30 * SECOND);
    let (mut before, mut after, mut buf) = (0, None, [0; 1472]);
    while net.now < end && after.is_none() {
        let now = net.now;
        while let Some((len, _)) = net.node(0).transmit(&mut buf, now) {
            if !(deaf..deaf + 21 * SECOND).contains(&now) {
                net.node(1).receive(&buf[..len], now).unwrap();
            }
        }
        while let Some((len, _)) = net.node(1).transmit(&mut buf, now) {
            net.node(0).receive(&buf[..len], now).unwrap();
            for part in Message::decode(&buf[..len]).unwrap().submessages() {
                match part {
                    Ok(Submessage::AckNack(body))
                        if body.writer == EntityId::SEDP_PUBLICATIONS_WRITER =>
                    {
                        if now < deaf + SECOND {
                            before = before.max(body.count);
                        } else {
                            after = after.or(Some(body.count));
                        }
                    }
                    _ => {}
                }
            }
        }
        net.now += 1_000_000;
    }
    assert!(
        before > 1 && after > Some(before),
        "{before}, then {after:?}"
    );
}

/// Endpoints are announced once. One that finds all places taken gets the next that is free.
#[test]
fn a_free_place_goes_to_an_endpoint_that_waits() {
    let limits = Limits {
        matches: 1,
        ..Limits::default()
    };
    let mut net = Net::new(1, limits);
    let writer = net.writer(0, Qos::ros());
    let listener = net.reader(0, Qos::ros()); // of this participant, has the writer's place
    for _ in 0..2 {
        let at = net.join(Limits::default());
        net.reader(at, Qos::ros());
    }
    net.run(SECOND);
    let matched = |net: &mut Net| net.node(0).writer(writer).unwrap().matched();
    assert_eq!(matched(&mut net), 1);
    let now = net.now;
    net.node(0).remove_reader(listener, now);
    assert_eq!(matched(&mut net), 1, "the next one");
    let mut readers = net.node(0).writer(writer).unwrap().readers();
    let next = usize::from(readers.next().unwrap().prefix.0[0]) - 1;
    drop(readers);
    net.node(next).leave(now);
    net.run(SECOND);
    assert_eq!(matched(&mut net), 1, "and the last");
    // And a reader's place goes to the next writer.
    let reader = net.reader(0, Qos::ros());
    net.run(SECOND);
    assert_eq!(net.node(0).reader(reader).unwrap().matched(), 1);
}

/// A participant whose endpoints found the bound reached is asked for them when it is no longer.
#[test]
fn an_endpoint_beyond_the_bound_is_met_when_there_is_room() {
    let limits = Limits {
        endpoints: 4,
        ..Limits::default()
    };
    let mut net = Net::new(1, limits);
    let reader = net.reader(0, Qos::ros());
    for _ in 0..2 {
        let at = net.join(Limits::default());
        net.writer(at, Qos::ros());
        for _ in 0..2 {
            net.reader(at, Qos::ros());
        }
        net.run(2 * SECOND);
    }
    let node = net.node(0);
    assert_eq!(node.endpoints().count(), 4);
    // The first falls silent, whose place is needed: the second is the first of the list then.
    net.nodes.remove(1);
    net.run(25 * SECOND);
    let node = net.node(0);
    assert_eq!(node.endpoints().count(), 3);
    assert_eq!(node.reader(reader).unwrap().matched(), 1);
}

/// A board that has the same name at each start: its numbers begin anew.
#[test]
fn a_participant_that_comes_back_under_its_name_is_heard() {
    // Seconds for which nothing comes from it; without: it says goodbye. Its lease is 20 s.
    let ways = [None, Some(21), Some(0)];
    for (qos, silence) in [Qos::ros(), Qos::sensor_data()]
        .into_iter()
        .flat_map(|qos| ways.map(|silence| (qos, silence)))
    {
        let mut net = Net::new(1, Limits::default());
        let reader = net.reader(0, qos);
        for count in [5, 3, 4] {
            let at = net.join(Limits::default());
            let writer = net.writer(at, qos);
            net.run(SECOND);
            for number in 1..=count {
                let now = net.now;
                net.node(at)
                    .write(writer, &sample(number), None, now)
                    .unwrap();
            }
            net.run(SECOND);
            let node = net.node(0);
            let got = std::iter::from_fn(|| node.take(reader).map(|s| s.payload[4])).count();
            assert_eq!(got, count as usize, "{qos:?}, silence {silence:?}");
            let now = net.now;
            if let Some(seconds) = silence {
                net.run(60 * SECOND);
                net.nodes.pop();
                net.run(seconds * SECOND);
            } else {
                net.node(at).leave(now);
                net.run(SECOND);
                net.nodes.pop();
            }
        }
    }
}

/// A robot has a network of its own besides, and a bridge to containers that has the same address
/// on every host.
#[test]
fn of_several_addresses_the_one_in_a_network_of_ours_is_sent_to() {
    let at = |ips: &[&str]| -> Locators {
        let there = |ip: &&str| SocketAddr::new(ip.parse().unwrap(), 7410);
        ips.iter().map(there).collect()
    };
    let node = |name, ips: &[&str]| {
        let config = ParticipantConfig {
            discovery: at(ips),
            user: at(ips),
            announce_to: &[GROUP.parse().unwrap()],
            ..ParticipantConfig::new(GuidPrefix([name; 12]))
        };
        Participant::new(&config, 1).unwrap()
    };
    for (ours, theirs, to) in [
        (
            &["10.0.0.9"][..],
            &["192.168.1.5", "10.0.0.7"][..],
            "10.0.0.7",
        ),
        (
            &["172.17.0.1", "10.0.0.9"],
            &["172.17.0.1", "10.0.0.7"],
            "10.0.0.7",
        ),
        (
            &["10.0.0.9", "192.168.1.9"],
            &["172.17.0.1", "192.168.1.5"],
            "192.168.1.5",
        ),
        (
            &["172.17.0.1", "10.0.0.9"],
            &["172.17.0.1", "10.0.0.9"],
            "172.17.0.1",
        ),
        (&["fd00::9"], &["fe80::1", "fd00::7"], "fd00::7"),
    ] {
        let (mut node, mut peer) = (node(1, ours), node(2, theirs));
        let (mut buf, mut sent) = ([0; 1472], Vec::new());
        while let Some((len, _)) = peer.transmit(&mut buf, 1) {
            node.receive(&buf[..len], 1).unwrap();
        }
        while let Some((_, to)) = node.transmit(&mut buf, 1) {
            sent.push(to);
        }
        let group = GROUP.parse().unwrap();
        sent.retain(|to| *to != group);
        assert!(!sent.is_empty());
        let there = SocketAddr::new(to.parse().unwrap(), 7410);
        assert!(
            sent.iter().all(|at| *at == there),
            "{ours:?} {theirs:?}: {sent:?}"
        );
    }
}

/// An announcement that cannot be read does not hide the one behind it in the same datagram.
#[test]
fn a_bad_announcement_does_not_hide_the_next() {
    let mut net = Net::new(2, Limits::default());
    net.run(SECOND);
    let now = net.now;
    let of = |topic| EndpointSpec::new(topic, "std_msgs::msg::dds_::Int32_");
    for topic in ["rt/first", "rt/second"] {
        net.node(0).create_writer(&of(topic), now).unwrap();
    }
    let second = net.node(1).create_reader(&of("rt/second"), now).unwrap();
    let (mut buf, mut damaged) = ([0; 1472], 0);
    while let Some((len, _)) = net.node(0).transmit(&mut buf, now) {
        let name = b"rt/first\0";
        if let Some(at) = buf[..len].windows(name.len()).position(|w| w == name) {
            // The length of the name, which stands before it.
            buf[at - 4..at].copy_from_slice(&u32::MAX.to_le_bytes());
            assert!(net.node(1).receive(&buf[..len], now).is_err());
            damaged += 1;
        }
    }
    assert_eq!(damaged, 1);
    assert_eq!(net.node(1).reader(second).unwrap().matched(), 1);
}

/// A program that runs for long has asserted its liveliness often: the last time is of use alone.
#[test]
fn a_late_joiner_gets_the_last_assertion_alone() {
    let mut net = Net::new(1, Limits::default());
    let qos = Qos {
        liveliness_lease: SECOND,
        ..Qos::ros()
    };
    net.writer(0, qos);
    net.run(60 * SECOND);
    let late = net.join(Limits::default());
    let (end, mut assertions, mut buf) = (net.now + SECOND / 2, 0, [0; 1472]);
    while net.now < end {
        let now = net.now;
        for (from, to) in [(0, late), (late, 0)] {
            while let Some((len, _)) = net.node(from).transmit(&mut buf, now) {
                let parts = Message::decode(&buf[..len]).unwrap().submessages();
                assertions += parts
                    .filter(|part| match part {
                        Ok(Submessage::Data(data)) => data.writer == EntityId::LIVELINESS_WRITER,
                        _ => false,
                    })
                    .count();
                net.node(to).receive(&buf[..len], now).unwrap();
            }
        }
        net.now += 1_000_000;
    }
    assert!((1..=4).contains(&assertions), "{assertions}");
}

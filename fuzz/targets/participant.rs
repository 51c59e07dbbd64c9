//! RTPS participants in virtual time: one gets the datagrams of another, lost, late, damaged and
//! twice, and datagrams of no participant. The other gets its own undamaged.
#![no_main]

use libfuzzer_sys::fuzz_target;
use replenish_rtps::participant::{
    EndpointSpec, Limits, Participant, ParticipantConfig, ReaderId, WriterId,
};
use replenish_rtps::ros::{GidSize, KnownNodes, NodeLimits, Nodes};
use replenish_rtps::wire::{CDR_LE, GuidPrefix, Nanos, Qos};
use std::net::SocketAddr;

const LIMITS: Limits = Limits {
    participants: 3,
    endpoints: 8,
    own_endpoints: 4,
    matches: 3,
    events: 16,
};
const MS: Nanos = 1_000_000;

struct Node {
    participant: Participant,
    writer: WriterId,
    reader: ReaderId,
}

fn address(number: u8) -> SocketAddr {
    ([127, 0, 0, 1], 8000 + u16::from(number)).into()
}

fn node(number: u8) -> Node {
    let config = ParticipantConfig {
        discovery: [address(number)].into_iter().collect(),
        user: [address(number)].into_iter().collect(),
        announce_to: &[address(3 - number)],
        limits: LIMITS,
        ..ParticipantConfig::new(GuidPrefix([number; 12]))
    };
    let mut participant = Participant::new(&config, 1).unwrap();
    let spec = EndpointSpec {
        qos: Qos::ros(),
        sample_bytes: 4000,
        ..EndpointSpec::new("rt/chatter", "std_msgs::msg::dds_::Int32_")
    };
    Node {
        writer: participant.create_writer(&spec, 1).unwrap(),
        reader: participant.create_reader(&spec, 1).unwrap(),
        participant,
    }
}

/// Datagrams of a participant, which end.
fn sent(node: &mut Node, now: Nanos) -> Vec<Vec<u8>> {
    let (mut all, mut buf) = (Vec::new(), [0; 1472]);
    while let Some((len, _)) = node.participant.transmit(&mut buf, now) {
        all.push(buf[..len].to_vec());
        assert!(all.len() < 5000, "no end");
    }
    all
}

fn samples(node: &mut Node, most: usize) -> usize {
    let mut count = 0;
    while let Some(sample) = node.participant.take(node.reader) {
        assert!(sample.payload.len() <= most);
        count += 1;
        assert!(count < 1000, "no end");
    }
    while node.participant.event().is_some() {}
    assert!(node.participant.participants().count() <= LIMITS.participants);
    assert!(node.participant.endpoints().count() <= LIMITS.endpoints);
    count
}

fuzz_target!(|bytes: &[u8]| {
    for size in [GidSize::Bytes16, GidSize::Bytes24] {
        if let Ok((_, nodes)) = Nodes::decode(bytes, size) {
            for node in nodes.flatten() {
                assert!(node.name.len() + node.namespace.len() <= bytes.len());
            }
        }
    }
    let limits = NodeLimits {
        nodes: 4,
        of_one: 3,
        endpoints: 8,
    };
    let mut known = KnownNodes::new(limits);
    let from = bytes.get(4..16).and_then(|prefix| prefix.try_into().ok());
    let from = GuidPrefix(from.unwrap_or_default());
    for _ in 0..2 {
        let _ = known.learn(from, bytes);
        assert!(known.names().count() <= 3 && known.endpoints().count() <= 8);
    }
    known.forget(from);
    assert_eq!(known.names().count(), 0);
    let (mut one, mut two) = (node(1), node(2));
    let (mut now, mut written) = (1, 0_u32);
    let mut held: Vec<Vec<u8>> = Vec::new();
    let mut script = bytes.iter().copied();
    while let Some(op) = script.next() {
        let how = script.next().unwrap_or(0);
        match op % 8 {
            0 => {
                let raw: Vec<u8> = script.by_ref().take(how.into()).collect();
                let _ = one.participant.receive(&raw, now);
            }
            1 | 2 => {
                written += 1;
                let len = usize::from(how) * 14;
                let sample = [&CDR_LE[..], &written.to_le_bytes(), &vec![how; len]].concat();
                let node = if op & 8 == 0 { &mut one } else { &mut two };
                let _ = node.participant.write(node.writer, &sample, None, now);
            }
            3 => now += Nanos::from(how) * MS,
            4 => now += Nanos::from(how) * Nanos::from(how) * MS,
            // Datagrams that were held back come late, the newest first.
            5 => {
                for old in held.iter().rev().take(how.into()) {
                    let _ = one.participant.receive(old, now);
                }
                held.clear();
            }
            _ => {}
        }
        for datagram in sent(&mut one, now) {
            two.participant.receive(&datagram, now).unwrap();
        }
        for mut datagram in sent(&mut two, now) {
            match op / 16 {
                0 => {}
                1 => held.push(datagram),
                2 => {
                    let (at, value) = (script.next().unwrap_or(0), script.next().unwrap_or(0));
                    let at = (usize::from(at) + usize::from(how) * 4) % datagram.len();
                    datagram[at] ^= value;
                    let _ = one.participant.receive(&datagram, now);
                }
                3 => {
                    datagram.truncate(datagram.len() * usize::from(how) / 256);
                    let _ = one.participant.receive(&datagram, now);
                }
                _ => {
                    let _ = one.participant.receive(&datagram, now);
                }
            }
        }
        held.truncate(64);
        for node in [&mut one, &mut two] {
            samples(node, 4000);
            assert!(node.participant.next_at(now) >= now);
        }
    }
});

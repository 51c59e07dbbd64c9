//! Real traffic of Fast DDS 3.2 (rclpy of ROS 2 Kilted) and Cyclone DDS 11: `tests/data`.
//!
//! Captured on the loopback interface: two rclpy nodes, two Cyclone
//! participants with a topic of 20 kB strings. A line is the peer's name and a datagram.

use crate::wire_golden::hex;
use replenish_rtps::wire::{
    Durability, EndpointData, EntityId, Message, MessageWriter, ParticipantData, Payload,
    Submessage, TypeHash, is_disposal,
};
use std::collections::BTreeMap;

const CAPTURE: &str = include_str!("../data/rtps-capture.txt");

fn datagrams() -> impl Iterator<Item = (&'static str, Vec<u8>)> {
    let lines = CAPTURE.lines().filter(|line| !line.starts_with('#'));
    lines.map(|line| {
        let (peer, bytes) = line.split_once(' ').unwrap();
        (peer, hex(bytes))
    })
}

/// Writes a submessage again; `None` for those with contents that the codec does not keep.
fn again(part: &Submessage<'_>, m: &mut MessageWriter<'_>) -> Option<()> {
    match part {
        Submessage::AckNack(body) => m.acknack(body).ok(),
        Submessage::Heartbeat(body) => m.heartbeat(body).ok(),
        Submessage::Gap(body) => m.gap(body).ok(),
        Submessage::NackFrag(body) => m.nack_frag(body).ok(),
        Submessage::HeartbeatFrag(body) => m.heartbeat_frag(body).ok(),
        Submessage::InfoDestination(prefix) => m.info_destination(*prefix).ok(),
        Submessage::Data(body) if body.inline_qos.is_none() => m.data(body, &[]).ok(),
        Submessage::DataFrag(body) if body.inline_qos.is_none() => m.data_frag(body, &[]).ok(),
        _ => None,
    }
}

#[test]
fn every_submessage_of_both_peers_is_read_and_written_byte_by_byte() {
    let mut kinds: BTreeMap<(&str, &str), u32> = BTreeMap::new();
    for (peer, bytes) in datagrams() {
        let message = Message::decode(&bytes).unwrap();
        let mut at = 20;
        for part in message.submessages() {
            let part = part.unwrap_or_else(|error| panic!("{peer}: {error} at {at}"));
            let len = usize::from(u16::from_le_bytes([bytes[at + 2], bytes[at + 3]]));
            let theirs = &bytes[at..at + 4 + len];
            at += 4 + len;
            let name = match part {
                Submessage::AckNack(_) => "ACKNACK",
                Submessage::Heartbeat(_) => "HEARTBEAT",
                Submessage::Gap(_) => "GAP",
                Submessage::NackFrag(_) => "NACK_FRAG",
                Submessage::HeartbeatFrag(_) => "HEARTBEAT_FRAG",
                Submessage::Data(_) => "DATA",
                Submessage::DataFrag(_) => "DATA_FRAG",
                Submessage::InfoDestination(_) => "INFO_DST",
                _ => "other",
            };
            *kinds.entry((peer, name)).or_default() += 1;
            let mut buf = vec![0; 70_000];
            let mut m = MessageWriter::new(&mut buf, message.prefix).unwrap();
            // Cyclone pads fragments' submessages less; others' sets may be longer than needed.
            if again(&part, &mut m).is_some() && m.len() == 20 + theirs.len() {
                assert_eq!(&m.message()[20..], theirs, "{peer} {part:?}");
                *kinds.entry((peer, "written again")).or_default() += 1;
            }
        }
        assert_eq!(at, bytes.len());
    }
    // Fast DDS's fragments have 64 kB and stay out of the file.
    assert!(kinds.contains_key(&("cyclone", "DATA_FRAG")), "{kinds:?}");
    for name in ["DATA", "HEARTBEAT", "ACKNACK", "INFO_DST"] {
        for peer in ["fast", "cyclone"] {
            assert!(kinds.contains_key(&(peer, name)), "{peer} {name} {kinds:?}");
        }
    }
    assert!(kinds[&("fast", "written again")] > 30, "{kinds:?}");
    assert!(kinds[&("cyclone", "written again")] > 30, "{kinds:?}");
}

#[test]
fn discovery_of_both_peers_is_understood() {
    let mut participants = BTreeMap::new();
    let mut topics = BTreeMap::new();
    let mut gone = BTreeMap::new();
    for (peer, bytes) in datagrams() {
        for part in Message::decode(&bytes).unwrap().submessages() {
            let Ok(Submessage::Data(data)) = part else {
                continue;
            };
            if is_disposal(data.inline_qos) {
                *gone.entry(peer).or_insert(0) += 1;
                continue;
            }
            let Payload::Data(payload) = data.payload else {
                continue;
            };
            if data.writer == EntityId::SPDP_WRITER {
                let read = ParticipantData::decode(payload).unwrap();
                assert_eq!(read.builtin & 0x3f, 0x3f);
                assert!(!read.metatraffic_unicast.is_empty());
                assert!(!read.default_unicast.is_empty());
                participants.insert(peer, (read.user_data.to_vec(), read.lease));
            } else if data.writer == EntityId::SEDP_PUBLICATIONS_WRITER {
                let read = EndpointData::decode(payload).unwrap();
                let hash = TypeHash::find(read.user_data).is_some();
                let partitions = read.partitions.count();
                topics.insert(read.topic.to_owned(), (read.qos, hash, partitions));
            }
        }
    }
    assert_eq!(
        participants["fast"],
        (b"enclave=/;\0".to_vec(), 20_000_000_000)
    );
    assert_eq!(participants["cyclone"].1, 10_000_000_000);
    let seconds = 1_000_000_000;
    let (qos, hash, _) = topics["rt/ns/limits"];
    assert!(hash);
    assert_eq!((qos.deadline, qos.lifespan), (2 * seconds, 3 * seconds));
    assert_eq!(qos.liveliness_lease, 4 * seconds);
    let (qos, hash, partitions) = topics["rt/cyc"];
    assert_eq!((hash, partitions), (false, 1));
    assert_eq!(qos.durability, Durability::TransientLocal);
    assert!(gone["fast"] > 0, "{gone:?}");
}

//! A bridge knows a bounded number of others: there are more participants than it takes in.

use crate::bridged::domain;
use replenish_agent::dds::{Dds, DdsConfig, DdsLimits, Node};
use replenish_os::WakeFd;
use replenish_rtps::participant::{EndpointSpec, Limits, Participant, ParticipantConfig, ReaderId};
use replenish_rtps::ros::{GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, KnownNodes, NodeLimits};
use replenish_rtps::udp::UdpConfig;
use replenish_rtps::wire::{GuidPrefix, Message, Submessage};
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// As many as the bridge takes in, and others.
const TAKEN: usize = 256;
const OTHERS: usize = 300;

/// A participant that reads the nodes of others. All share a socket.
fn listener(number: usize, domain: u16, socket: &UdpSocket) -> (Participant, ReaderId) {
    let at = [socket.local_addr().unwrap()].into_iter().collect();
    let bridge = UdpConfig::unicast(domain, Ipv4Addr::LOCALHOST, 1).next();
    let mut prefix = [7; 12];
    prefix[10..].copy_from_slice(&u16::try_from(number).unwrap().to_be_bytes());
    let config = ParticipantConfig {
        domain: domain.into(),
        discovery: at,
        user: at,
        announce_to: &[bridge.unwrap()],
        limits: Limits {
            participants: 1,
            endpoints: 4,
            own_endpoints: 2,
            matches: 1,
            events: 16,
        },
        ..ParticipantConfig::new(GuidPrefix(prefix))
    };
    let mut participant = Participant::new(&config, 1).unwrap();
    let spec = EndpointSpec {
        qos: GRAPH_QOS,
        sample_bytes: 8192,
        ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
    };
    let reader = participant.create_reader(&spec, 1).unwrap();
    (participant, reader)
}

/// Whether the message names our node.
fn names_it(from: GuidPrefix, payload: &[u8]) -> bool {
    let mut known = KnownNodes::new(NodeLimits {
        nodes: 2,
        of_one: 2,
        endpoints: 2,
    });
    known.learn(from, payload).unwrap();
    known.names().any(|name| name == "/board")
}

#[test]
fn as_many_participants_hear_of_a_node_as_are_taken_in_and_the_others_are_counted() {
    let domain = domain();
    let config = DdsConfig {
        limits: DdsLimits {
            endpoints: 4,
            ..DdsLimits::DEFAULT
        },
        ..DdsConfig::default()
    };
    let dds = Dds::start(&config, Arc::new(WakeFd::new().unwrap())).unwrap();
    let name = "board".to_string();
    dds.open_node(1, Node { domain, name }).unwrap();
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket.set_nonblocking(true).unwrap();
    let mut others: Vec<_> = (0..OTHERS)
        .map(|at| listener(at, domain, &socket))
        .collect();
    let mut hears = vec![false; OTHERS];
    let (begun, mut buf) = (Instant::now(), [0; 1 << 16]);
    let heard = |hears: &[bool]| hears.iter().filter(|hears| **hears).count();
    while heard(&hears) < TAKEN || dds.left_out() < (OTHERS - TAKEN) as u64 {
        let state = (heard(&hears), dds.left_out());
        assert!(begun.elapsed() < Duration::from_secs(60), "{state:?}");
        let now = u64::try_from(begun.elapsed().as_nanos()).unwrap() + 1;
        for ((participant, reader), hears) in others.iter_mut().zip(&mut hears) {
            while let Some((len, to)) = participant.transmit(&mut buf, now) {
                socket.send_to(&buf[..len], to).unwrap();
            }
            while let Some(sample) = participant.take(*reader) {
                *hears |= names_it(sample.writer.prefix, sample.payload);
            }
        }
        while let Ok(len) = socket.recv(&mut buf) {
            let message = Message::decode(&buf[..len]).unwrap();
            let to = message.submessages().find_map(|part| match part {
                Ok(Submessage::InfoDestination(prefix)) => Some(prefix),
                _ => None,
            });
            for (participant, _) in &mut others {
                if to.is_none_or(|to| to == participant.prefix() || to == GuidPrefix::default()) {
                    participant.receive(&buf[..len], now).unwrap();
                }
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(heard(&hears), TAKEN);
    assert_eq!(dds.report().left_out, dds.left_out());
}

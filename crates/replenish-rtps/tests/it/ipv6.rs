//! Two participants over IPv6 alone, one that speaks both versions, and addresses within reach.

use replenish_rtps::participant::{EndpointSpec, ReaderId};
use replenish_rtps::udp::{UdpConfig, UdpParticipant};
use replenish_rtps::wire::{CDR_LE, Locators, Qos, Reach};
use replenish_testkit::domain::domain;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::{Duration, Instant};

const LOCAL: Ipv6Addr = Ipv6Addr::LOCALHOST;
const V4: &[Ipv4Addr] = &[Ipv4Addr::LOCALHOST];
const V6: &[(Ipv6Addr, u32)] = &[(LOCAL, 1)];

fn open(domain: u16, v4: &[Ipv4Addr], v6: &[(Ipv6Addr, u32)]) -> UdpParticipant {
    let mut peers: Vec<SocketAddr> = Vec::new();
    if !v4.is_empty() {
        peers.extend(UdpConfig::unicast(domain, Ipv4Addr::LOCALHOST, 4));
    }
    if !v6.is_empty() {
        peers.extend(UdpConfig::unicast(domain, LOCAL, 4));
    }
    let config = UdpConfig {
        domain,
        interfaces: v4,
        interfaces6: v6,
        multicast: false,
        peers: &peers,
        ..UdpConfig::default()
    };
    UdpParticipant::open(&config).unwrap()
}

fn spec() -> EndpointSpec<'static> {
    EndpointSpec {
        qos: Qos::latched(100),
        ..EndpointSpec::new("rt/numbers", "std_msgs::msg::dds_::Int32_")
    }
}

fn reader(node: &mut UdpParticipant) -> ReaderId {
    let now = node.now();
    node.participant_mut().create_reader(&spec(), now).unwrap()
}

/// A hundred numbers come once and in order from the first to each of the others.
fn exchange(mut from: UdpParticipant, to: Vec<UdpParticipant>) {
    let now = from.now();
    let writer = from.participant_mut().create_writer(&spec(), now).unwrap();
    for number in 0_u8..100 {
        let [a, b, c, d] = CDR_LE;
        let sample = [a, b, c, d, number, 0, 0, 0];
        from.participant_mut()
            .write(writer, &sample, None, now)
            .unwrap();
    }
    let mut to: Vec<_> = to
        .into_iter()
        .map(|mut node| (reader(&mut node), node, Vec::new()))
        .collect();
    let begin = Instant::now();
    while to.iter().any(|(_, _, got)| got.len() < 100) {
        assert!(begin.elapsed() < Duration::from_secs(60), "not all came");
        from.step(Duration::from_millis(1)).unwrap();
        for (reader, node, got) in &mut to {
            node.step(Duration::from_millis(1)).unwrap();
            while let Some(sample) = node.participant_mut().take(*reader) {
                got.push(sample.payload[4]);
            }
        }
    }
    for (_, _, got) in to {
        assert_eq!(got, (0..100).collect::<Vec<_>>());
    }
}

#[test]
fn two_participants_hear_each_other_over_ipv6_alone() {
    let domain = domain();
    let (from, to) = (open(domain, &[], V6), open(domain, &[], V6));
    let found = UdpConfig::unicast(domain, LOCAL, 1).next().unwrap();
    assert_eq!(found.to_string(), format!("[::1]:{}", 7410 + 250 * domain));
    exchange(from, vec![to]);
}

/// One socket takes datagrams of both versions.
#[test]
fn one_that_speaks_both_is_heard_over_either() {
    let domain = domain();
    let from = open(domain, V4, V6);
    exchange(from, vec![open(domain, V4, &[]), open(domain, &[], V6)]);
}

#[test]
fn the_address_of_a_version_that_is_spoken_is_chosen() {
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let both: Locators = [
        address("[fd00::7]:7411"),
        address("192.0.2.7:7411"),
        address("[::1]:7411"),
    ]
    .into_iter()
    .collect();
    let reach = |local, v4, v6| Reach { local, v4, v6 };
    for (reach, best) in [
        (reach(false, true, false), Some("192.0.2.7:7411")),
        (reach(true, true, false), Some("192.0.2.7:7411")),
        (reach(false, false, true), Some("[fd00::7]:7411")),
        (reach(true, false, true), Some("[::1]:7411")),
        (reach(false, true, true), Some("192.0.2.7:7411")),
    ] {
        assert_eq!(
            both.best(reach, &Locators::NONE),
            best.map(address),
            "{reach:?}"
        );
    }
    let v6: Locators = [address("[fd00::7]:7411")].into_iter().collect();
    assert_eq!(v6.best(reach(false, true, false), &Locators::NONE), None);
}

//! XRCE clients, the agent and DDS: another program of `replenish_agent::dds` in the place of a
//! ROS 2 node, over loopback. The foreign peers are in `dds_peers.rs`.

use crate::bridged::{
    Client, agent, dds_program, domain, service_client, topic_client, typed_client, writers,
};
use replenish_agent::RunningAgent;
use replenish_agent::dds::{Durability, EndpointKind, Outgoing, Qos, RequestId, Topic};
use replenish_rtps::udp::{UdpConfig, UdpParticipant};
use replenish_xrce::wire::{Notice, ObjectId, ObjectKind, Status, StreamId};
use std::time::{Duration, Instant};

const TYPE: &str = "std_msgs::msg::dds_::Int32_";

fn topic(name: &str) -> Topic {
    Topic::new(name, TYPE)
}

/// Whether the agent's reader of `rt/down` has found a writer.
fn agent_knows_the_writer(agent: &RunningAgent) -> bool {
    let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
    snapshot
        .bridge
        .iter()
        .flatten()
        .any(|b| b.name == "rt/down" && b.kind == "data_reader" && b.matched > 0)
}

#[test]
fn samples_cross_in_both_directions_and_do_not_come_back() {
    for stream in [StreamId::BEST_EFFORT, StreamId::RELIABLE] {
        let reliable = stream == StreamId::RELIABLE;
        let domain = domain();
        let agent = agent(domain);
        let qos = Qos {
            reliable,
            ..Qos::default()
        };
        let mut ros = dds_program(domain);
        let heard = ros.reader(&topic("rt/up"), qos);
        let said = ros.writer(&topic("rt/down"), qos);
        // Writes up, reads down, and a second one that reads what the first one writes.
        let mut one = topic_client(&agent, 1, "rt/up", "rt/down", stream);
        let mut two = topic_client(&agent, 2, "rt/other", "rt/up", stream);
        ros.matched(heard, 1);
        ros.matched(said, 1);
        // DDS finds each side by itself: the agent's reader must know the program's writer, too.
        let begun = std::time::Instant::now();
        while !agent_knows_the_writer(&agent) {
            assert!(begun.elapsed() < Duration::from_secs(60), "not matched");
            std::thread::sleep(Duration::from_millis(10));
        }
        for i in 0..100_u32 {
            one.write(stream, &i.to_le_bytes());
            assert_eq!(ros.next(heard).payload, i.to_le_bytes());
            assert_eq!(two.read(), i.to_le_bytes());
            ros.write(said, &(i + 1000).to_le_bytes());
            assert_eq!(one.read(), (i + 1000).to_le_bytes());
        }
        // Nothing more has come anywhere: no sample went in a circle.
        two.idle(Duration::from_millis(100));
        assert_eq!(two.got.len() + one.got.len(), 0);
        let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
        let bridge = snapshot.bridge.unwrap();
        let find = |name: &str, kind: &str| {
            let found = bridge.iter().find(|b| b.name == name && b.kind == kind);
            found.unwrap_or_else(|| panic!("{name} in {bridge:?}"))
        };
        assert_eq!(find("rt/up", "data_writer").counts.sent, 100);
        assert_eq!(find("rt/down", "data_reader").counts.received, 100);
        assert_eq!(
            find("rt/up", "data_reader").counts.received,
            0,
            "its own are left out"
        );
        assert!(bridge.iter().all(|b| b.state == "open"), "{bridge:?}");
        assert_eq!(
            (snapshot.stats.bridge_in, snapshot.stats.bridge_dropped),
            (100, 0)
        );
        // Clients that leave are gone in DDS.
        one.close();
        two.close();
        ros.matched(heard, 0);
        ros.matched(said, 0);
        agent.stop().unwrap();
    }
}

/// The bridge announces the hash of a type that it knows by its name, for writers, readers and both
/// parts of a service; that of a type of the user's own it does not know.
#[test]
fn type_hashes_of_common_packages_are_announced() {
    let domain = domain();
    let agent = agent(domain);
    let stream = StreamId::RELIABLE;
    let own = "own_msgs::msg::dds_::Int32_";
    let _common = topic_client(&agent, 1, "rt/up", "rt/down", stream);
    let _own = typed_client(&agent, 2, own, ("rt/own_up", "rt/own_down"), stream);
    let _asks = service_client(&agent, 3, ObjectKind::Requester);
    let mut ros = UdpParticipant::open(&UdpConfig {
        domain,
        ..UdpConfig::default()
    })
    .unwrap();
    // As rclpy shows them.
    let int32 = "b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1cef0deb";
    let add = "e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a";
    let expected = [
        ("rq/addRequest", Some(add)),
        ("rr/addReply", Some(add)),
        ("rt/down", Some(int32)),
        ("rt/own_down", None),
        ("rt/own_up", None),
        ("rt/up", Some(int32)),
    ];
    let begun = Instant::now();
    loop {
        ros.step(Duration::from_millis(20)).unwrap();
        let digits = |hash: [u8; 32]| hash.map(|byte| format!("{byte:02x}")).concat();
        let ends = ros.participant().endpoints();
        let ends = ends.filter(|end| end.topic() != "ros_discovery_info");
        let seen: std::collections::BTreeMap<_, _> = ends
            .map(|end| (end.topic(), end.type_hash.map(|hash| digits(hash.0))))
            .collect();
        let seen: Vec<_> = seen
            .iter()
            .map(|(name, hash)| (*name, hash.as_deref()))
            .collect();
        if seen.len() == expected.len() {
            assert_eq!(seen, expected);
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{seen:?}");
    }
    agent.stop().unwrap();
}

/// The agent reports endpoints that do not fit together to the client, whichever end is the
/// client's; it knows them from DDS. It reports once, although the others' discovery repeats
/// itself.
#[test]
fn clients_are_told_of_clashes_with_endpoints_in_dds() {
    let domain = domain();
    let agent = agent(domain);
    let weak = Qos {
        reliable: false,
        ..Qos::default()
    };
    let latched = Qos {
        durability: Durability::TransientLocal,
        ..Qos::default()
    };
    let mut ros = dds_program(domain);
    ros.writer(&topic("rt/down"), weak);
    ros.reader(&topic("rt/up"), latched);
    let mut strong = topic_client(&agent, 1, "rt/none", "rt/down", StreamId::RELIABLE);
    strong.until(|client| !client.clashes.is_empty());
    let mut best_effort = topic_client(&agent, 2, "rt/up", "rt/none", StreamId::BEST_EFFORT);
    best_effort.until(|client| !client.clashes.is_empty());
    // Others come: with nothing new to tell, and with a policy that fitted until now.
    ros.writer(&topic("rt/down"), weak);
    let impatient = Qos {
        deadline: Some(1_000_000),
        ..Qos::default()
    };
    ros.reader(&topic("rt/up"), impatient);
    best_effort.until(|client| client.clashes.len() > 1);
    strong.idle(Duration::from_millis(300));
    let kinds = |found: &[(ObjectId, u8)]| -> Vec<_> {
        let kinds = found
            .iter()
            .map(|(object, policies)| (object.kind().ok(), *policies));
        kinds.collect()
    };
    let reader = Some(ObjectKind::DataReader);
    assert_eq!(kinds(&strong.clashes), [(reader, Notice::RELIABILITY)]);
    let writer = Some(ObjectKind::DataWriter);
    let both = Notice::RELIABILITY | Notice::DURABILITY;
    let all = both | Notice::DEADLINE;
    assert_eq!(kinds(&best_effort.clashes), [(writer, both), (writer, all)]);
    agent.stop().unwrap();
}

#[test]
fn requests_and_replies_cross_in_both_directions() {
    let domain = domain();
    let agent = agent(domain);
    let mut ros = dds_program(domain);
    let (request, reply) = crate::bridged::service_topics();
    let (rq, rr) = (request.clone(), reply.clone());
    let replier = ros.open(EndpointKind::Replier {
        request: rq,
        reply: rr,
    });
    let mut caller = service_client(&agent, 1, ObjectKind::Requester);
    // Sent at once: the agent waits until the server is found.
    let first = caller.request(b"ask1");
    let ask = ros.next(replier);
    assert_eq!(ask.payload, b"ask1");
    let answer = Outgoing::call(ask.request.unwrap(), b"yes1".to_vec());
    ros.dds.write(replier, answer);
    assert_eq!(caller.reply(), (first, b"yes1".to_vec()));
    caller.until(|caller| caller.served);
    ros.dds.close(replier);
    caller.until(|caller| !caller.served);

    let mut server = service_client(&agent, 2, ObjectKind::Replier);
    let requester = ros.open(EndpointKind::Requester { request, reply });
    ros.matched(requester, 2);
    let name = RequestId {
        guid: [3; 16],
        sequence: 77,
    };
    ros.dds
        .write(requester, Outgoing::call(name, b"ask2".to_vec()));
    let asked = server.read();
    let (identity, text) = asked.split_at(24);
    assert_eq!(text, b"ask2");
    server.write(StreamId::RELIABLE, &[identity, b"yes2"].concat());
    let got = ros.next(requester);
    assert_eq!((got.request, &got.payload[..]), (Some(name), &b"yes2"[..]));

    // Among the agent's own clients requests are answered as ever, and once.
    caller.until(|caller| caller.served);
    let second = caller.request(b"ask3");
    let asked = server.read();
    let (identity, text) = asked.split_at(24);
    assert_eq!(text, b"ask3");
    server.write(StreamId::RELIABLE, &[identity, b"yes3"].concat());
    assert_eq!(caller.reply(), (second, b"yes3".to_vec()));
    server.idle(Duration::from_millis(100));
    assert!(
        server.got.is_empty(),
        "the request has not come again over DDS"
    );
    agent.stop().unwrap();
}

/// With its identity the reply is longer than a submessage can say. Unless the agent was asked for
/// long samples, it goes to no client: those of others do not know them.
#[test]
fn a_reply_that_is_too_long_with_its_identity_is_dropped_and_counted() {
    let domain = domain();
    let agent = agent(domain);
    let mut ros = dds_program(domain);
    let (request, reply) = crate::bridged::service_topics();
    let replier = ros.open(EndpointKind::Replier { request, reply });
    let mut caller = service_client(&agent, 1, ObjectKind::Requester);
    caller.request(b"long");
    let ask = ros.next(replier);
    let answer = Outgoing::call(ask.request.unwrap(), vec![1; 65_530]);
    ros.dds.write(replier, answer);
    let refused = || {
        let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
        snapshot.stats.samples_refused
    };
    caller.until(|_| refused() == 1);
    let short = caller.request(b"more");
    let ask = ros.next(replier);
    ros.dds.write(
        replier,
        Outgoing::call(ask.request.unwrap(), b"yes1".to_vec()),
    );
    assert_eq!(caller.reply(), (short, b"yes1".to_vec()));
    agent.stop().unwrap();
}

#[test]
fn entities_beyond_the_limit_wait_for_their_turn() {
    let domain = domain();
    let agent = crate::bridged::agent_with(domain, |limits| limits.endpoints = 4);
    let mut ros = dds_program(domain);
    let heard = ros.reader(&topic("rt/b"), Qos::default());
    // Each client has a participant, a writer and a reader.
    let one = topic_client(&agent, 1, "rt/a", "rt/x", StreamId::RELIABLE);
    let mut two = topic_client(&agent, 2, "rt/b", "rt/y", StreamId::RELIABLE);
    let states = || {
        let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
        let bridge = snapshot.bridge.unwrap();
        bridge.into_iter().map(|b| b.state).collect::<Vec<String>>()
    };
    let full = |states: &[String]| states.iter().filter(|s| s.contains("too many")).count();
    let eventually = |all: usize, too_many: usize| {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            let states = states();
            if (states.len(), full(&states)) == (all, too_many) {
                return;
            }
            assert!(Instant::now() < deadline, "{states:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    eventually(6, 2);
    one.close();
    ros.matched(heard, 1);
    two.write(StreamId::RELIABLE, b"now!");
    assert_eq!(ros.next(heard).payload, b"now!");
    eventually(3, 0);
    agent.stop().unwrap();
}

/// Before, a client that brought more names than there may be got OK for all of them. No client's
/// new name was bridged until the agent's restart. The same happened to a name with another type
/// than one that nothing used any more.
#[test]
fn names_that_cannot_cross_are_refused_and_others_still_can() {
    let domain = domain();
    let agent = crate::bridged::agent_with(domain, |limits| limits.topics = 64);
    let names: Vec<_> = (0..10).map(|n| (format!("rt/n{n}"), TYPE)).collect();
    let greedy = writers(&agent, 1, &names);
    let refused = greedy.refused.as_ref().unwrap();
    assert_eq!(refused.len(), 2, "an eighth of 64 names for one client");
    assert!(
        refused
            .iter()
            .all(|(_, status)| *status == Status::RESOURCES)
    );
    let wrong = writers(&agent, 2, &[("rt/a".into(), "Wrong_")]);
    let right = writers(&agent, 3, &[("rt/a".into(), TYPE)]);
    let status = |client: &Client| client.refused.as_ref().unwrap().first().map(|(_, s)| *s);
    assert_eq!(status(&wrong), None);
    assert_eq!(status(&right), Some(Status::INCOMPATIBLE));
    let log: Vec<String> = agent
        .inspector()
        .rejections()
        .list
        .iter()
        .map(ToString::to_string)
        .collect();
    let says = |text: &str| log.iter().any(|line| line.contains(text));
    assert!(says("topic names of one client in DDS = 8"), "{log:?}");
    assert!(
        says("types of a topic name in DDS while endpoints use it = 1"),
        "{log:?}"
    );
    // A name that nothing uses takes the right type, and its samples cross.
    wrong.close();
    right.close();
    let mut ros = dds_program(domain);
    let heard = ros.reader(&topic("rt/a"), Qos::default());
    let mut client = topic_client(&agent, 4, "rt/a", "rt/y", StreamId::RELIABLE);
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        // Until both have found each other, samples are lost.
        client.write(StreamId::RELIABLE, b"1234");
        client.idle(Duration::from_millis(100));
        if let Some(sample) = ros.within(heard, Duration::from_millis(100)) {
            assert_eq!(sample.payload, b"1234");
            break;
        }
        assert!(Instant::now() < deadline, "nothing crosses");
    }
    let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
    let bridge = snapshot.bridge.unwrap();
    let row = bridge.iter().find(|row| row.name == "rt/a").unwrap();
    assert_eq!(row.client, "04040404");
    assert_eq!((&*row.node, &*row.type_name), ("/mcu/node_4", TYPE));
    assert!(row.counts.sent > 0);
    agent.stop().unwrap();
}

/// Resident memory of this process in bytes: client, agent, its DDS and another program in DDS.
fn resident() -> u64 {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap();
    let pages = statm.split(' ').nth(1).unwrap();
    pages.parse::<u64>().unwrap() * 4096
}

/// 30 000 reliable samples of 64 bytes to DDS and back, or `REPLENISH_SOAK` many, and what that
/// does to the memory. Nightly: `cargo test -p replenish-agent --test it --
/// --ignored --nocapture soak`.
#[test]
#[ignore = "takes a minute; prints figures"]
fn soak() {
    let messages = std::env::var("REPLENISH_SOAK").map_or(30_000, |count| count.parse().unwrap());
    let step: u64 = messages / 6;
    let domain = domain();
    let agent = agent(domain);
    let mut ros = dds_program(domain);
    let heard = ros.reader(&topic("rt/up"), Qos::default());
    let said = ros.writer(&topic("rt/down"), Qos::default());
    let stream = StreamId::RELIABLE;
    let mut client = topic_client(&agent, 1, "rt/up", "rt/down", stream);
    ros.matched(heard, 1);
    ros.matched(said, 1);
    let mut after_warm_up = 0;
    let start = Instant::now();
    for i in 0..=messages {
        if i % step == 0 {
            let kilobytes = resident() / 1024;
            println!("{i:>6} there and back: {kilobytes} kB resident");
        }
        if i == step {
            after_warm_up = resident();
        }
        let payload = [&i.to_le_bytes()[..], &[0; 56]].concat();
        client.write(stream, &payload);
        let sample = ros.next(heard);
        assert_eq!(sample.payload, payload);
        ros.write(said, &sample.payload);
        assert_eq!(client.read(), payload);
    }
    let micros = start.elapsed().as_micros() / u128::from(messages);
    let growth = resident().saturating_sub(after_warm_up);
    println!(
        "{micros} us each; {} kB more than after {step}",
        growth / 1024
    );
    assert!(growth < 32 << 20, "{growth} bytes since message {step}");
    let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
    let bridge = snapshot.bridge.unwrap();
    let dropped: u64 = bridge
        .iter()
        .map(|b| b.counts.dropped_in + b.counts.dropped_out + b.counts.missed)
        .sum();
    assert_eq!(dropped, 0, "{bridge:?}");
    agent.stop().unwrap();
}

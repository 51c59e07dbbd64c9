//! The agent survives any message of any sender, in any order.
//!
//! It goes on, keeps its bounds, and serves the next client as if nothing had been.

use crate::support::{Client, Got, MS, World, data};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::wire::{
    CreationMode, DeliveryControl, Entity, ObjectId, ObjectKind, Representation, Status, StreamId,
    TopicBinary,
};
use std::sync::OnceLock;

const LIMITS: Limits = Limits {
    clients: 4,
    entities: 8,
    streams: 3,
    message: 1000,
    sample: 5000,
    client_bytes: 200_000,
    default_depth: 4,
    max_depth: 8,
    datagrams_per_second: 0,
    unauthenticated_per_second: 0,
    silence: 30_000 * MS,
    ..Limits::DEFAULT
};

/// The clients' messages of the capture, as a start.
fn corpus() -> &'static [Vec<u8>] {
    static CORPUS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    CORPUS.get_or_init(|| {
        let from_clients = crate::common::capture()
            .into_iter()
            .filter(|d| d.from_client);
        from_clients.map(|d| d.bytes).collect()
    })
}

fn datagram() -> impl Strategy<Value = Vec<u8>> {
    let changes = vec((any::<Index>(), any::<u8>()), 0..4);
    let mutated =
        (any::<Index>(), changes, any::<Option<Index>>()).prop_map(|(which, changes, cut)| {
            let mut bytes = which.get(corpus()).clone();
            for (at, value) in changes {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            bytes
        });
    // Requests about objects that exist, stream control about streams that exist, and nonsense.
    let body = prop_oneof![
        (0_u8..15, vec(any::<u8>(), 0..40))
            .prop_map(|(kind, rest)| { [&[0, 20, 0, 0x10 | kind], &rest[..]].concat() }),
        (0_u8..20, 0_u8..20, any::<bool>()).prop_map(|(first, second, reliable)| {
            vec![first, 0, second, 0, if reliable { 0x80 } else { 0x01 }]
        }),
        vec(any::<u8>(), 0..60),
    ];
    let flags = prop_oneof![Just(1_u8), any::<u8>()];
    let ids = prop_oneof![3 => 0_u8..17, 2 => Just(7_u8), 1 => Just(8_u8)];
    let submessage = (ids, flags, body).prop_map(|(id, flags, body)| {
        let mut bytes = vec![id, flags, u8::try_from(body.len()).unwrap(), 0];
        bytes.extend(body);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    });
    let streams = prop_oneof![3 => Just(0_u8), 1 => Just(1), 1 => Just(0x80), 1 => any::<u8>()];
    let made = (streams, 0_u16..20, vec(submessage, 0..4)).prop_map(|(stream, seq, body)| {
        let mut bytes = vec![0x81, stream];
        bytes.extend(seq.to_le_bytes());
        bytes.extend(body.concat());
        bytes
    });
    prop_oneof![
        4 => any::<Index>().prop_map(|which| which.get(corpus()).clone()),
        4 => mutated,
        3 => made,
        1 => vec(any::<u8>(), 0..100),
    ]
}

/// Sends until there is nothing more to send, which must come soon.
fn pump(agent: &mut AgentCore<u32>, now: Now) {
    let mut sent = 0;
    while agent.pump(now, 16, &mut |_, bytes| {
        assert!((4..=1000).contains(&bytes.len()));
        sent += 1;
    }) {
        assert!(sent < 10_000, "no end");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, ..ProptestConfig::default() })]

    #[test]
    fn any_datagrams_in_any_order(
        storm in vec((prop_oneof![4 => 0_u32..2, 1 => 2_u32..6], 0_u64..50, datagram()), 1..200),
    ) {
        let mut world = World::new(LIMITS);
        for (peer, stream) in [(0, StreamId::RELIABLE), (1, StreamId::BEST_EFFORT)] {
            let mut victim = Client::open(&mut world, peer, 100 + peer as u8);
            victim.endpoint(&mut world, true, Some(4));
            victim.read(&mut world, 1, stream, Some(DeliveryControl::UNLIMITED));
        }
        let before = world.agent.stats().datagrams_in;
        for (peer, milliseconds, bytes) in &storm {
            world.now += milliseconds * MS;
            let now = Now { monotonic: world.now, unix: 0 };
            world.agent.receive(now, *peer, bytes);
            pump(&mut world.agent, now);
            prop_assert!(world.agent.stats().clients <= 4);
            // Nothing is left undone, or this would be asked for again without end.
            prop_assert!(world.agent.next_deadline().is_none_or(|at| at > world.now));
        }
        prop_assert_eq!(world.agent.stats().datagrams_in, before + storm.len() as u64);

        // After the silence, there is room and peace for a client that behaves.
        world.pass(30_000 * MS);
        prop_assert_eq!(world.agent.stats().clients, 0);
        world.sent.clear();
        let mut client = Client::new(1, 77);
        prop_assert_eq!(client.login(&mut world), [Got::Agent(Status::OK)]);
        client.endpoint(&mut world, true, Some(4));
        client.read(&mut world, 1, StreamId::RELIABLE, Some(DeliveryControl::UNLIMITED));
        prop_assert_eq!(client.write(&mut world, 1, b"fine"), [data(1, b"fine")]);
    }
}

/// The memory that samples may take is bounded for each client, and free again afterwards.
#[test]
fn samples_that_nobody_fetches_are_bounded() {
    let limits = Limits {
        entities: 64,
        sample: 1000,
        client_bytes: 120_000,
        max_depth: 1000,
        default_depth: 1000,
        ..LIMITS
    };
    let world = &mut World::new(limits);
    let mut clients: Vec<Client> = (1..=4).map(|i| Client::open(world, i, i as u8)).collect();
    for client in &mut clients {
        client.endpoint(world, true, Some(1000));
    }
    // One sample is shared by four readers: it is kept once, and counted for each of them.
    for i in 0..20 {
        clients[0].write(world, 1, &[i; 400]);
    }
    assert_eq!(world.agent.snapshot(world.at()).queued_bytes, 20 * 400);
    clients[0].write(world, 1, &[0; 1001]);
    let stats = world.agent.stats();
    assert_eq!(stats.samples_refused, 1, "too large");
    assert_eq!(stats.samples_dropped, 0);

    // A reader of each client on a topic of its own: now nothing is shared.
    for (i, client) in clients.iter_mut().enumerate() {
        client.topic(world, 2, 1, &format!("own{i}"), "T");
        client.writer(world, 2);
        client.reader(world, 2, 1000);
        for _ in 0..200 {
            client.write(world, 2, &[1; 400]);
        }
    }
    let stats = world.agent.stats();
    assert!(stats.samples_dropped > 4 * 100, "{}", stats.samples_dropped);
    let snapshot = world.agent.snapshot(world.at());
    assert!(snapshot.queued_bytes <= limits.memory());
    for client in &snapshot.clients {
        assert!(client.bytes <= limits.client_bytes, "{}", client.bytes);
    }
    world.pass(30_000 * MS);
    let mut again = Client::open(world, 9, 9);
    again.endpoint(world, true, Some(8));
    again.write(world, 1, &[1; 400]);
    let after = world.agent.stats();
    assert_eq!(after.samples_refused, stats.samples_refused);
    assert_eq!(after.samples_dropped, stats.samples_dropped);
}

/// b209253 kept the samples of all clients in one pool: ten strangers filled it, and of 20 samples
/// between two others none arrived, although all 20 were acknowledged.
#[test]
fn strangers_take_no_memory_of_other_clients() {
    let limits = Limits {
        clients: 12,
        entities: 64,
        client_bytes: 150_000,
        max_depth: 1000,
        ..LIMITS
    };
    let world = &mut World::new(limits);
    let mut talker = Client::open(world, 100, 100);
    let mut listener = Client::open(world, 101, 101);
    talker.endpoint(world, false, None);
    listener.endpoint(world, false, None);
    let keep_all = |world: &mut World, client: &mut Client, number| {
        let qos = replenish_xrce::wire::EndpointQos {
            flags: replenish_xrce::wire::QOS_RELIABLE,
            ..Default::default()
        };
        let reader = replenish_xrce::wire::ReaderQos {
            endpoint: qos,
            ..Default::default()
        };
        assert_eq!(client.writer_with(world, number, qos), Status::OK);
        assert_eq!(client.reader_with(world, number, reader), Status::OK);
    };
    let mut strangers: Vec<Client> = (1..=10).map(|i| Client::open(world, i, i as u8)).collect();
    for (i, stranger) in strangers.iter_mut().enumerate() {
        stranger.endpoint(world, false, None);
        stranger.topic(world, 2, 1, &format!("junk{i}"), "T");
        keep_all(world, stranger, 2);
        for _ in 0..300 {
            stranger.write(world, 2, &[1; 1000]);
        }
    }
    let kept = world.agent.snapshot(world.at()).queued_bytes;
    assert!(kept > 300_000, "they have filled what they may: {kept}");
    keep_all(world, &mut talker, 1);
    keep_all(world, &mut listener, 1);
    listener.read(
        world,
        1,
        StreamId::RELIABLE,
        Some(DeliveryControl::UNLIMITED),
    );
    let mut arrived = 0;
    for i in 0..20 {
        talker.write(world, 1, &[i; 1000]);
        arrived += usize::from(listener.got(world) == [data(1, &[i; 1000])]);
    }
    assert_eq!(arrived, 20);
}

/// b209253 counted no names: a client took 80 MB with descriptions alone.
#[test]
fn descriptions_count_as_memory_of_their_client() {
    let limits = Limits {
        entities: 4096,
        client_bytes: 200_000,
        ..LIMITS
    };
    let world = &mut World::new(limits);
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    let id = |number| ObjectId::new(number, ObjectKind::Topic);
    let name = "n".repeat(250);
    let mut statuses = (1..200).map(|number| {
        let topic = TopicBinary {
            name: &name,
            type_reference: None,
            type_name: Some("T"),
        };
        let entity = Entity::Topic {
            repr: Representation::Binary(topic),
            participant: ObjectId::new(1, ObjectKind::Participant),
        };
        let status = client.create(world, id(number), CreationMode::default(), entity);
        let bytes = world.agent.snapshot(world.at()).clients[0].bytes;
        assert!(bytes <= limits.client_bytes, "{bytes}");
        status
    });
    let refused = statuses.position(|status| status == Status::RESOURCES);
    assert!(
        refused.is_some_and(|at| (20..60).contains(&at)),
        "{refused:?}"
    );
    drop(statuses);
    // An entity that is deleted counts no more.
    client.delete(world, id(1));
    let before = world.agent.snapshot(world.at()).clients[0].bytes;
    assert!(before <= limits.client_bytes - 1900, "{before}");
}

/// A world in which 256 peers are at each host.
fn hosts(limits: Limits) -> World {
    let mut world = World::new(limits);
    let host = |peer: &u32| Some(std::net::Ipv4Addr::from_bits(peer >> 8).into());
    world.agent = AgentCore::new(limits).hosts(host);
    world
}

/// On b209253 64 log-ins from one address closed the agent for all others: no place was ever free
/// again while they sent a sign of life now and then.
#[test]
fn log_ins_from_one_host_leave_places_for_others() {
    for lively in [false, true] {
        let world = &mut hosts(Limits::DEFAULT);
        let mut flood: Vec<Client> = (1..=64).map(|i| Client::new(i, i as u8)).collect();
        let mut opened = 0;
        for honest in 0..100_u32 {
            for client in &mut flood {
                client.login(world);
                if lively {
                    client.write_loosely(world, 1, b"alive");
                }
            }
            let mut client = Client::new((honest + 1) << 8, 100 + honest as u8);
            for _ in 0..8 {
                world.pass(250 * MS);
                if client.login(world) == [Got::Agent(Status::OK)] {
                    opened += 1;
                    break;
                }
            }
            client.endpoint(world, true, Some(4));
            client.delete(world, ObjectId::CLIENT);
            world.sent.clear();
        }
        assert_eq!(opened, 100, "lively: {lively}");
        assert!(world.agent.stats().clients_displaced > 0);
    }
}

/// On b209253 everything without a session had one budget: junk from one address made three or four
/// of eight log-ins fail.
#[test]
fn junk_from_one_address_leaves_log_ins_to_others() {
    let limits = Limits {
        unauthenticated_per_second: 1000,
        ..Limits::DEFAULT
    };
    let world = &mut hosts(limits);
    let mut capture = corpus().iter().cycle();
    let attacker = 1;
    let mut failed = 0;
    for round in 0..40_u32 {
        for i in 0..100_u32 {
            world.pass(MS);
            for _ in 0..20 {
                let junk = capture.next().unwrap();
                // From one address, and from many ports of one host.
                world.deliver(attacker, junk);
                world.deliver(0x100 + i % 200, junk);
            }
        }
        world.sent.clear();
        // One at the host of the flood, and one elsewhere.
        for (peer, key) in [(0xf0, 200), (0xa00, 201)] {
            let mut client = Client::new(peer + (round << 12), key);
            failed += usize::from(client.login(world) != [Got::Agent(Status::OK)]);
            client.delete(world, ObjectId::CLIENT); // the next one is elsewhere
        }
    }
    assert_eq!(failed, 0);
}

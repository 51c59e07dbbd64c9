//! Whatever arrives, from whomever, in whatever order: the agent goes on, keeps its bounds, and
//! serves the next client as if nothing had been.

use crate::support::{Client, Got, MS, World, data};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::wire::{DeliveryControl, Status, StreamId};
use std::sync::OnceLock;

const LIMITS: Limits = Limits {
    clients: 4,
    entities: 8,
    streams: 3,
    message: 1000,
    sample: 5000,
    queued_bytes: 20_000,
    default_depth: 4,
    max_depth: 8,
    datagrams_per_second: 0,
    unauthenticated_per_second: 0,
    silence: 30_000 * MS,
    ..Limits::DEFAULT
};

/// What clients sent in the capture, as a start.
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

/// The memory that samples may take is bounded over all clients, and free again afterwards.
#[test]
fn samples_that_nobody_fetches_are_bounded() {
    let mut world = World::new(Limits {
        entities: 16,
        sample: 1000,
        queued_bytes: 10_000,
        ..LIMITS
    });
    let world = &mut world;
    let mut clients: Vec<Client> = (1..=4).map(|i| Client::open(world, i, i as u8)).collect();
    for client in &mut clients {
        client.endpoint(world, true, Some(8));
    }
    // One sample is shared by four readers: eight of them are 8000 bytes, not 32000.
    for i in 0..20 {
        clients[0].write(world, 1, &[i; 400]);
    }
    assert_eq!(world.agent.stats().samples_refused, 0);
    clients[0].write(world, 1, &[0; 1001]);
    assert_eq!(world.agent.stats().samples_refused, 1, "too large");

    // A reader of each client on a topic of its own: now nothing is shared.
    for (i, client) in clients.iter_mut().enumerate() {
        client.topic(world, 2, 1, &format!("own{i}"), "T");
        client.writer(world, 2);
        client.reader(world, 2, 8);
        for _ in 0..8 {
            client.write(world, 2, &[1; 400]);
        }
    }
    let stats = world.agent.stats();
    let refused = stats.samples_refused - 1;
    assert_eq!(
        refused,
        32 - 17,
        "3200 shared bytes leave room for 17 samples"
    );
    world.pass(30_000 * MS);
    let mut again = Client::open(world, 9, 9);
    again.endpoint(world, true, Some(8));
    again.write(world, 1, &[1; 400]);
    assert_eq!(world.agent.stats().samples_refused, stats.samples_refused);
}

//! The bound on the memory of an agent's process: the page has it term by term, as it is computed.

use crate::support::{Client, MS, World};
use replenish_agent::{AgentConfig, DdsBridge, Limits, MemoryBound};
use replenish_xrce::wire::{
    CreationMode, DeliveryControl, Entity, ObjectId, ObjectKind, ParticipantBinary, Representation,
    Status, StreamId, TopicBinary,
};

/// The page's table is what `MemoryBound` prints for the agent's defaults with a TCP port.
#[test]
fn the_page_adds_up_the_bound() {
    let config = AgentConfig {
        tcp: Some(([127, 0, 0, 1], 8889).into()),
        ..AgentConfig::default()
    };
    let bound = MemoryBound::of(&config);
    println!("{bound}");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/agent.md");
    let page = std::fs::read_to_string(page).unwrap();
    for line in bound.to_string().lines() {
        let of_page: Vec<&str> = page.lines().filter(|row| row.starts_with('|')).collect();
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let found = of_page.iter().any(|row| {
            let row: Vec<&str> = row.split('|').map(str::trim).collect();
            row.get(1) == cells.get(1) && row.get(2) == cells.get(2)
        });
        assert!(found, "docs/agent.md has no row {line}");
    }
    let sum: usize = bound.terms().iter().map(|(_, bytes)| bytes).sum();
    assert_eq!(sum, bound.total());
    let bridged = AgentConfig {
        dds: Some(DdsBridge::default()),
        ..config
    };
    let bridge = MemoryBound::of(&bridged).total() - bound.total();
    let adds = format!("bridge adds {} MiB", bridge.div_ceil(1 << 20));
    assert!(page.contains(&adds), "docs/agent.md does not say: {adds}");
}

/// No limits make the bound overflow, and a higher limit never makes it smaller.
#[test]
fn the_bound_grows_with_every_limit() {
    let total = |change: fn(&mut Limits)| {
        let mut config = AgentConfig::default();
        change(&mut config.limits);
        MemoryBound::of(&config).total()
    };
    let usual = total(|_| ());
    assert!(total(|limits| limits.clients = 65) > usual);
    assert!(total(|limits| limits.entities = 129) > usual);
    assert!(total(|limits| limits.streams = 7) > usual);
    assert!(total(|limits| limits.client_bytes += 1) > usual);
    let most = total(|limits| {
        (limits.clients, limits.entities) = (4096, 4096);
        limits.client_bytes = 1 << 40;
    });
    assert!(most > 4096 << 40);
}

/// Names are at most as long as those of DDS, and nothing in them can be taken for something else
/// in a log.
#[test]
fn names_that_dds_does_not_have_are_refused() {
    let world = &mut World::new(Limits::default());
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    let participant = ObjectId::new(1, ObjectKind::Participant);
    let mut topic = |name: &str, type_name: &str| {
        let repr = Representation::Binary(TopicBinary {
            name,
            type_reference: None,
            type_name: Some(type_name),
        });
        let entity = Entity::Topic { repr, participant };
        let id = ObjectId::new(2, ObjectKind::Topic);
        client.create(world, id, CreationMode::REUSE_OR_REPLACE, entity)
    };
    let long = "n".repeat(256);
    assert_eq!(topic(&long[..255], &long[..255]), Status::OK);
    assert_eq!(topic(&long, "T"), Status::RESOURCES);
    assert_eq!(topic("t", &long), Status::RESOURCES);
    assert_eq!(topic("a\x1b[2J", "T"), Status::INVALID_DATA);
    assert_eq!(topic("Grüße", "T"), Status::OK);
    let name = Some(&*long);
    let repr = Representation::Binary(ParticipantBinary {
        name,
        ..ParticipantBinary::default()
    });
    let entity = Entity::Participant { repr, domain: 0 };
    let id = ObjectId::new(3, ObjectKind::Participant);
    let mode = CreationMode::default();
    assert_eq!(client.create(world, id, mode, entity), Status::RESOURCES);
    let refusals = world.agent.snapshot(world.at()).refusals;
    let why = &refusals.last().unwrap().reason;
    assert!(why.ends_with("bytes of a name = 255"), "{why}");
}

/// Samples without a byte in them cost memory all the same: an entry, and its place in a queue.
#[test]
fn samples_without_bytes_are_counted() {
    let limits = Limits {
        max_depth: 65_535,
        client_bytes: 1 << 20,
        datagrams_per_second: 0,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(65_535));
    for _ in 0..20_000 {
        client.write_loosely(world, 1, b"");
    }
    let snapshot = world.agent.snapshot(world.at());
    let queued = snapshot.clients[0].entities.iter();
    let queued: usize = queued.filter_map(|e| e.reader).map(|r| r.queued).sum();
    assert!((1000..4000).contains(&queued), "{queued}");
    assert!(snapshot.clients[0].bytes <= 1 << 20);
    world.pass(MS);
}

/// A writer that sends on without waiting for confirmations makes the agent remember so many
/// messages, and no more: the oldest count as confirmed, late.
#[test]
fn messages_that_wait_for_their_readers_are_bounded() {
    let world = &mut World::new(Limits {
        datagrams_per_second: 0,
        ..Limits::default()
    });
    let mut talker = Client::open(world, 1, 1);
    talker.endpoint(world, true, None);
    let mut listener = Client::open(world, 2, 2);
    listener.endpoint(world, false, Some(256));
    listener.read(
        world,
        1,
        StreamId::RELIABLE,
        Some(DeliveryControl::UNLIMITED),
    );
    listener.acknowledging = false;
    for i in 0..240 {
        talker.write(world, 1, &[i; 8]);
    }
    let stats = world.agent.stats();
    assert_eq!(stats.samples_in, 240);
    assert_eq!(stats.confirmed_late, 240 - 128, "no time has passed");
}

//! Many clients, and long times: in virtual time.

use crate::support::{Client, MS, World, data, payloads};
use replenish_agent::{AgentConfig, Limits};
use replenish_xrce::wire::{DeliveryControl, Status, StreamId};

const UNLIMITED: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);
const SECOND: u64 = 1000 * MS;

fn roomy() -> World {
    World::with(&AgentConfig {
        limits: Limits {
            unauthenticated_per_second: 0,
            ..Limits::default()
        },
        ..AgentConfig::default()
    })
}

/// 64 clients with 8 topics each at 100 Hz; each is heard by the next client.
#[test]
fn sixty_four_clients_with_eight_topics_each() {
    let world = &mut roomy();
    let mut clients: Vec<Client> = (1..=64).map(|i| Client::open(world, i, i as u8)).collect();
    for (i, client) in clients.iter_mut().enumerate() {
        assert_eq!(client.participant(world, 1, 0), Status::OK);
        for topic in 0..8_u16 {
            let (mine, theirs) = (2 * topic + 1, 2 * topic + 2);
            client.topic(world, mine, 1, &format!("t{topic}_{i}"), "T");
            client.topic(
                world,
                theirs,
                1,
                &format!("t{topic}_{}", (i + 63) % 64),
                "T",
            );
            client.writer(world, mine);
            client.reader(world, theirs, 10);
            client.read(world, theirs, StreamId::RELIABLE, UNLIMITED);
        }
    }
    let mut kept = Vec::new();
    for round in 0..60_u32 {
        for i in 0..64 {
            for topic in 0..8_u16 {
                clients[i].write(world, 2 * topic + 1, &round.to_le_bytes());
            }
            let got = payloads(&clients[(i + 1) % 64].got(world));
            assert_eq!(got, vec![round.to_le_bytes().to_vec(); 8]);
        }
        world.pass(10 * MS);
        let snapshot = world.agent.snapshot(world.at());
        kept.push((snapshot.queued_bytes, snapshot.clients[0].bytes));
    }
    assert_eq!(kept[5], kept[59], "memory is flat");
    let stats = world.agent.stats();
    assert_eq!(stats.samples_out, 64 * 8 * 60);
    assert_eq!((stats.samples_dropped, stats.retransmitted), (0, 0));
}

/// A day, and more messages than there are sequence numbers; the clock begins near its end.
#[test]
fn a_day_and_sequence_numbers_that_wrap() {
    let world = &mut roomy();
    world.now = u64::MAX / 2;
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    for i in 0..70_000_u32 {
        let bytes = i.to_le_bytes();
        assert_eq!(client.write(world, 1, &bytes), [data(1, &bytes)], "{i}");
        world.pass(1235 * MS);
        client.got(world);
    }
    assert!(world.now - u64::MAX / 2 > 24 * 3600 * SECOND);
    let stats = world.agent.stats();
    assert_eq!((stats.clients, stats.clients_reaped), (1, 0));
    assert_eq!((stats.samples_dropped, stats.retransmitted), (0, 0));
}

#[test]
fn the_end_of_the_clock_is_no_end_of_the_agent() {
    let world = &mut roomy();
    world.now = u64::MAX - 5 * SECOND;
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    for i in 0..40 {
        world.pass(100 * MS);
        assert_eq!(client.write(world, 1, &[i; 4]), [data(1, &[i; 4])]);
    }
}

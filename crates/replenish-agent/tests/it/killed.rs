//! A reliable keep-all reader that is killed, and starts again: for how long its old session holds
//! up the writers, and that nothing acknowledged is missing afterwards.

use crate::support::{Client, Got, MS, World, payloads};
use replenish_agent::Limits;
use replenish_xrce::wire::{
    DeliveryControl, EndpointQos, QOS_RELIABLE, ReaderQos, Status, StreamId,
};

const SECOND: u64 = 1000 * MS;
const ALL: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);

const KEEP_ALL: EndpointQos<'static> = EndpointQos {
    flags: QOS_RELIABLE,
    depth: Some(10),
    deadline_ms: None,
    lifespan_ms: None,
    user_data: None,
};

fn limits() -> Limits {
    Limits {
        max_depth: 10,
        ..Limits::default()
    }
}

fn reader(world: &mut World, mut client: Client) -> (Client, Vec<Vec<u8>>) {
    client.endpoint(world, false, None);
    let qos = ReaderQos {
        endpoint: KEEP_ALL,
        ..ReaderQos::default()
    };
    assert_eq!(client.reader_with(world, 1, qos), Status::OK);
    let got = payloads(&client.read(world, 1, StreamId::RELIABLE, ALL));
    (client, got)
}

/// A writer that is held up by a reader that was killed; the number of its sample that waits.
fn held_up(world: &mut World) -> (Client, u8) {
    let mut talker = Client::open(world, 1, 1);
    talker.endpoint(world, false, None);
    assert_eq!(talker.writer_with(world, 1, KEEP_ALL), Status::OK);
    let (mut killed, _) = {
        let client = Client::open(world, 2, 2);
        reader(world, client)
    };
    killed.acknowledging = false;
    for number in 0..200 {
        let before = world.agent.stats().samples_in;
        talker.write(world, 1, &[number; 4]);
        if world.agent.stats().samples_in == before {
            return (talker, number);
        }
    }
    panic!("nothing holds it up");
}

/// Another key is another client: the agent does not identify it by its name, and two programs of
/// one name are allowed in ROS 2. So the killed reader's session stays until `limits.silence`, and
/// what is acknowledged meanwhile is nothing.
#[test]
fn a_killed_reader_that_returns_with_another_key_holds_up_writers_until_it_was_silent_too_long() {
    let world = &mut World::new(limits());
    let (mut talker, waiting) = held_up(world);
    let client = Client::open(world, 3, 3);
    let (mut back, mut got) = reader(world, client);
    let silence = limits().silence;
    let killed_at = world.now;
    let taken = world.agent.stats().samples_in;
    while world.agent.stats().samples_in == taken {
        assert!(
            world.now - killed_at <= silence + 2 * SECOND,
            "held up for ever"
        );
        world.pass(SECOND / 2);
        talker.again(world, &[waiting; 4]);
        got.extend(payloads(&back.acknowledge(world)));
    }
    assert!(world.now - killed_at >= silence, "ended too early");
    assert_eq!(world.agent.stats().clients, 2, "the killed one has gone");
    // Samples that waited for it alone are counted; they were acknowledged before the other reader
    // was there.
    assert!(world.agent.stats().samples_orphaned > 0);
    for number in waiting + 1..waiting + 100 {
        talker.write(world, 1, &[number; 4]);
        got.extend(payloads(&back.got(world)));
    }
    let expected: Vec<Vec<u8>> = (waiting..waiting + 100).map(|n| vec![n; 4]).collect();
    assert_eq!(got, expected);
    assert_eq!(world.agent.stats().samples_dropped, 0);
}

/// With a key of its own it takes its place again in 0.75 s, at whatever port it starts.
#[test]
fn a_killed_reader_that_returns_with_its_key_holds_up_writers_for_a_second() {
    let world = &mut World::new(limits());
    let (mut talker, waiting) = held_up(world);
    let killed_at = world.now;
    let mut client = Client::new(3, 2);
    while client.login(world) != [Got::Agent(Status::OK)] {
        world.pass(250 * MS);
        assert!(world.now - killed_at <= 1250 * MS, "its place is not free");
    }
    let (mut back, mut got) = reader(world, client);
    for number in waiting..waiting + 100 {
        if number == waiting {
            talker.again(world, &[number; 4]);
        } else {
            talker.write(world, 1, &[number; 4]);
        }
        got.extend(payloads(&back.got(world)));
    }
    let expected: Vec<Vec<u8>> = (waiting..waiting + 100).map(|n| vec![n; 4]).collect();
    assert_eq!(got, expected);
}

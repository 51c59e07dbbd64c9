//! QoS between writers and readers, and how much of its samples a client wants how fast.

use crate::support::{Client, Got, MS, World, data, payloads};
use replenish_agent::{AgentConfig, Limits, TopicRule};
use replenish_xrce::wire::{
    DeliveryControl, EndpointQos, ObjectId, ObjectKind, QOS_DURABILITY_TRANSIENT_LOCAL,
    QOS_HISTORY_KEEP_LAST, QOS_RELIABLE, ReaderQos, Status, StreamId,
};

const SECOND: u64 = 1000 * MS;
const UNLIMITED: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);
const LAST: u16 = QOS_HISTORY_KEEP_LAST;
const DURABLE: u16 = QOS_DURABILITY_TRANSIENT_LOCAL;

fn qos(flags: u16, depth: u16) -> EndpointQos<'static> {
    EndpointQos {
        flags,
        depth: Some(depth),
        ..EndpointQos::default()
    }
}

fn reading(flags: u16, depth: u16) -> ReaderQos<'static> {
    ReaderQos {
        endpoint: qos(flags, depth),
        ..ReaderQos::default()
    }
}

/// A client with participant and topic 1, and nothing else.
fn bare(world: &mut World, peer: u32) -> Client {
    let mut client = Client::open(world, peer, peer as u8);
    client.endpoint(world, false, None);
    client
}

/// Writer and reader of one client.
fn pair(world: &mut World, writer: EndpointQos<'_>, reader: ReaderQos<'_>) -> Client {
    let mut client = bare(world, 1);
    assert_eq!(client.writer_with(world, 1, writer), Status::OK);
    assert_eq!(client.reader_with(world, 1, reader), Status::OK);
    client
}

#[test]
fn a_reader_hears_only_writers_that_offer_what_it_asks_for() {
    let cases = [
        (0, 0, true),
        (0, QOS_RELIABLE, false),
        (QOS_RELIABLE, QOS_RELIABLE, true),
        (QOS_RELIABLE, DURABLE, false),
        (DURABLE, DURABLE, true),
        (DURABLE, 0, true),
    ];
    for (offered, asked, talks) in cases {
        let world = &mut World::new(Limits::default());
        let mut client = pair(world, qos(LAST | offered, 9), reading(LAST | asked, 9));
        client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
        let got = client.write(world, 1, b"hear");
        assert_eq!(
            payloads(&got).len(),
            usize::from(talks),
            "{offered} {asked}"
        );
        let mismatches = world.agent.stats().qos_mismatches;
        assert_eq!(mismatches, u64::from(!talks));
        let snapshot = world.agent.snapshot(world.at());
        let reader = snapshot.clients[0].entities.iter().find_map(|e| e.reader);
        assert_eq!(reader.unwrap().mismatched, usize::from(!talks));
    }
}

#[test]
fn who_comes_late_gets_what_durable_writers_have_kept() {
    let world = &mut World::new(Limits::default());
    let mut talker = bare(world, 1);
    talker.writer_with(world, 1, qos(LAST | DURABLE | QOS_RELIABLE, 3));
    for i in 0..5 {
        talker.write(world, 1, &[i; 4]);
    }
    let mut late = bare(world, 2);
    late.reader_with(world, 1, reading(LAST | DURABLE, 10));
    let got = late.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(got, [data(1, &[2; 4]), data(1, &[3; 4]), data(1, &[4; 4])]);
    talker.write(world, 1, b"live");
    assert_eq!(late.got(world), [data(1, b"live")]);

    let mut volatile = bare(world, 3);
    volatile.reader_with(world, 1, reading(LAST, 10));
    assert_eq!(
        volatile.read(world, 1, StreamId::RELIABLE, UNLIMITED),
        [],
        "has not asked for it"
    );
    talker.delete(world, ObjectId::new(1, ObjectKind::DataWriter));
    let mut later = bare(world, 4);
    later.reader_with(world, 1, reading(LAST | DURABLE, 10));
    assert_eq!(
        later.read(world, 1, StreamId::RELIABLE, UNLIMITED),
        [],
        "gone with its writer"
    );
}

#[test]
fn what_is_too_old_is_dropped_and_counted() {
    let world = &mut World::new(Limits::default());
    let fresh = EndpointQos {
        lifespan_ms: Some(100),
        ..qos(LAST | DURABLE, 10)
    };
    let mut client = pair(world, fresh, reading(LAST, 10));
    client.write(world, 1, b"old!");
    world.pass(60 * MS);
    client.write(world, 1, b"new!");
    world.pass(40 * MS);
    let got = client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(got, [data(1, b"new!")]);
    assert_eq!(world.agent.stats().samples_expired, 1);
    world.pass(60 * MS);
    let mut late = bare(world, 2);
    late.reader_with(world, 1, reading(LAST | DURABLE, 10));
    assert_eq!(late.read(world, 1, StreamId::RELIABLE, UNLIMITED), []);
}

#[test]
fn missed_deadlines_are_counted_and_samples_too_close_are_filtered() {
    let world = &mut World::new(Limits::default());
    let promised = EndpointQos {
        deadline_ms: Some(50),
        ..qos(LAST, 10)
    };
    let filter = ReaderQos {
        time_filter_ms: Some(20),
        ..reading(LAST, 10)
    };
    let mut client = pair(world, promised, filter);
    for i in 0..10 {
        client.write(world, 1, &[i; 4]);
        world.pass(10 * MS);
    }
    assert_eq!(world.agent.stats().deadlines_missed, 0);
    assert_eq!(world.agent.stats().samples_filtered, 5);
    world.pass(41 * MS);
    client.write(world, 1, b"late");
    assert_eq!(world.agent.stats().deadlines_missed, 1);
}

/// A keep-all reader that is slow: nothing is lost, the writer waits, and goes on by itself.
#[test]
fn keep_all_writers_wait_for_keep_all_readers() {
    let limits = Limits {
        max_depth: 20,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut talker = bare(world, 1);
    talker.writer_with(world, 1, qos(QOS_RELIABLE, 1));
    let mut slow = bare(world, 2);
    slow.reader_with(world, 1, reading(QOS_RELIABLE, 1));
    slow.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    slow.acknowledging = false;
    let mut sent = 0_u8;
    while world.agent.stats().held_back == 0 {
        talker.write(world, 1, &[sent; 4]);
        sent += 1;
        assert!(sent < 200);
    }
    // 16 under way, 20 in the queue, and the last one not taken.
    assert_eq!(sent, 16 + 20 + 1);
    let before = payloads(&slow.got(world)).len();
    slow.acknowledging = true;
    let got = payloads(&slow.acknowledge(world));
    assert_eq!(before + got.len(), 36);
    let named: Vec<Got> = talker.got(world);
    assert!(
        matches!(named[..], [.., Got::Ack(_, 1)]),
        "asked to send the last one again: {named:?}"
    );
    talker.again(world, &[sent - 1; 4]);
    assert_eq!(payloads(&slow.got(world)), [[sent - 1; 4]]);
    assert_eq!(world.agent.stats().samples_dropped, 0);
}

#[test]
fn the_wait_for_a_keep_all_reader_ends() {
    let limits = Limits {
        max_depth: 4,
        writer_block_limit: Some(500 * MS),
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut talker = bare(world, 1);
    talker.writer_with(world, 1, qos(QOS_RELIABLE, 1));
    let mut stuck = bare(world, 2);
    stuck.reader_with(world, 1, reading(QOS_RELIABLE, 1));
    stuck.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    stuck.acknowledging = false;
    for i in 0..20 {
        talker.write(world, 1, &[i; 4]);
    }
    assert_eq!(
        world.agent.stats().held_back,
        0,
        "full, but not asked for more"
    );
    talker.write(world, 1, b"wait");
    assert_eq!(world.agent.stats().held_back, 1);
    world.pass(500 * MS);
    assert!(matches!(talker.got(world)[..], [.., Got::Ack(_, 1)]));
    talker.again(world, b"wait");
    for i in 0..200 {
        talker.write(world, 1, &[i; 4]);
    }
    assert_eq!(world.agent.stats().held_back, 1);
    assert!(world.agent.stats().samples_dropped > 100);
}

/// Sends `sample` once; whether the agent has taken it.
fn is_taken(world: &mut World, talker: &mut Client, sample: &[u8]) -> bool {
    let before = world.agent.stats().samples_in;
    talker.write(world, 1, sample);
    world.agent.stats().samples_in > before
}

/// b209253 waited for a second: of 1000 acknowledged samples for a reader that stood still longer,
/// 464 arrived. Its client had asked for some samples, and asked for no more meanwhile.
#[test]
fn a_reader_that_stands_still_for_minutes_loses_nothing() {
    for grant in [5, DeliveryControl::UNLIMITED_SAMPLES] {
        let limits = Limits {
            max_depth: 10,
            silence: 3600 * SECOND,
            ..Limits::default()
        };
        let world = &mut World::new(limits);
        let mut talker = bare(world, 1);
        talker.writer_with(world, 1, qos(QOS_RELIABLE, 1));
        let mut slow = bare(world, 2);
        slow.reader_with(world, 1, reading(QOS_RELIABLE, 1));
        let control = DeliveryControl {
            max_samples: grant,
            ..DeliveryControl::UNLIMITED
        };
        let mut got = payloads(&slow.read(world, 1, StreamId::RELIABLE, Some(control)));
        slow.acknowledging = false;
        let mut sent = 0_u8;
        while is_taken(world, &mut talker, &[sent; 4]) {
            sent += 1;
        }
        assert!((15..=27).contains(&sent), "{sent}");
        for _ in 0..100 {
            world.pass(3 * SECOND);
            talker.again(world, &[sent; 4]);
        }
        assert_eq!(world.agent.stats().samples_in, u64::from(sent));
        slow.acknowledging = true;
        got.extend(payloads(&slow.acknowledge(world)));
        while got.len() <= usize::from(sent) {
            let before = got.len();
            got.extend(payloads(&slow.read(
                world,
                1,
                StreamId::RELIABLE,
                Some(control),
            )));
            talker.again(world, &[sent; 4]);
            got.extend(payloads(&slow.got(world)));
            assert!(got.len() > before, "{} of {sent} and one", got.len());
        }
        let expected: Vec<Vec<u8>> = (0..=sent).map(|i| vec![i; 4]).collect();
        assert_eq!(got, expected);
        assert_eq!(world.agent.stats().samples_dropped, 0);
    }
}

/// b209253 took 64 samples above the depth, because it looked after it had taken one: a message
/// with more in it, or more writers, lost the rest.
#[test]
fn many_samples_in_one_message_and_many_writers_wait_for_one_reader() {
    let limits = Limits {
        max_depth: 4,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut slow = bare(world, 99);
    slow.reader_with(world, 1, reading(QOS_RELIABLE, 1));
    let mut got = Vec::new();
    let one = Some(DeliveryControl {
        max_samples: 1,
        ..DeliveryControl::UNLIMITED
    });
    got.extend(payloads(&slow.read(world, 1, StreamId::RELIABLE, one)));
    let mut talkers: Vec<Client> = (1..=20).map(|peer| bare(world, peer)).collect();
    let mut expected = Vec::new();
    for (of, talker) in (0_u8..).zip(&mut talkers) {
        talker.writer_with(world, 1, qos(QOS_RELIABLE, 1));
        let samples: Vec<Vec<u8>> = (0..10).map(|i| vec![of, i, 0, 0]).collect();
        talker.write_packed(world, 1, &samples);
        expected.extend(samples);
    }
    for _ in 0..10_000 {
        if got.len() == expected.len() {
            break;
        }
        got.extend(payloads(&slow.read(world, 1, StreamId::RELIABLE, one)));
        for (of, talker) in (0_u8..).zip(&mut talkers) {
            let samples: Vec<Vec<u8>> = (0..10).map(|i| vec![of, i, 0, 0]).collect();
            talker.packed_again(world, 1, &samples);
        }
        got.extend(payloads(&slow.got(world)));
    }
    assert_eq!(world.agent.stats().samples_dropped, 0);
    for of in 0..20 {
        let order: Vec<u8> = got.iter().filter(|s| s[0] == of).map(|s| s[1]).collect();
        assert_eq!(order, (0..10).collect::<Vec<u8>>(), "writer {of}");
    }
    assert_eq!(got.len(), expected.len());
}

#[test]
fn bytes_per_second_and_pace_are_kept() {
    for (bytes, pace, expected) in [(1000, 0, 10 + 100), (0, 50, 200), (100, 30, 1 + 10)] {
        let world = &mut World::new(Limits::default());
        let mut client = pair(world, qos(LAST, 9), reading(LAST, 9));
        let control = DeliveryControl {
            max_bytes_per_second: bytes,
            min_pace_ms: pace,
            ..DeliveryControl::UNLIMITED
        };
        client.read(world, 1, StreamId::BEST_EFFORT, Some(control));
        let mut got = 0;
        for _ in 0..1000 {
            client.write_loosely(world, 1, &[7; 100]);
            world.pass(10 * MS);
            got += payloads(&client.got(world)).len();
        }
        assert!(got.abs_diff(expected) <= 1, "{bytes} {pace}: {got}");
    }
}

/// Nothing arrives meanwhile: the agent wakes up by itself.
#[test]
fn what_is_held_back_comes_when_its_time_has_come() {
    let world = &mut World::new(Limits::default());
    let mut client = pair(world, qos(LAST, 9), reading(LAST, 9));
    let control = DeliveryControl {
        min_pace_ms: 100,
        max_elapsed_s: 1,
        ..DeliveryControl::UNLIMITED
    };
    let start = world.now;
    client.read(world, 1, StreamId::RELIABLE, Some(control));
    for i in 0..9 {
        client.write(world, 1, &[i; 4]);
    }
    let mut times = vec![start];
    while world.now < start + 2 * SECOND {
        let next = world.agent.next_deadline().unwrap();
        world.pass((next - world.now).min(2 * SECOND));
        times.extend(payloads(&client.got(world)).iter().map(|_| world.now));
    }
    let expected: Vec<u64> = (0..9).map(|i| start + i * 100 * MS).collect();
    assert_eq!(times, expected);
    client.write(world, 1, b"late");
    world.pass(SECOND);
    assert_eq!(
        payloads(&client.got(world)),
        Vec::<Vec<u8>>::new(),
        "it has ended"
    );
}

#[test]
fn urgent_topics_go_first_and_are_not_kept_waiting_by_a_full_window() {
    let config = AgentConfig {
        rules: vec![
            TopicRule::new("urgent", 7),
            TopicRule::new("bulk*", 0),
            TopicRule {
                weight: 3,
                ..TopicRule::new("heavy", 4)
            },
        ],
        ..AgentConfig::default()
    };
    let world = &mut World::with(&config);
    let mut client = bare(world, 1);
    for (number, name) in [(2, "bulk1"), (3, "urgent"), (4, "heavy"), (5, "light")] {
        client.topic(world, number, 1, name, "T");
        client.writer(world, number);
        client.reader(world, number, 100);
        client.read(world, number, StreamId::RELIABLE, UNLIMITED);
    }
    client.write(world, 3, b"open");
    client.acknowledging = false;
    for i in 0..40 {
        client.write(world, 2, &[i; 4]);
    }
    let got = client.write(world, 3, b"now!");
    assert_eq!(got, [data(3, b"now!")], "room was kept for it");
    for i in 0..6 {
        client.write(world, 4, &[i; 4]);
        client.write(world, 5, &[i; 4]);
        client.write(world, 3, &[i; 4]);
    }
    client.acknowledging = true;
    let got = client.acknowledge(world);
    let order: String = got
        .iter()
        .filter_map(|got| match got {
            Got::Data(id, _) => Some(["b", "u", "h", "l"][usize::from(id.number() - 2)]),
            _ => None,
        })
        .collect();
    assert!(order.starts_with("uuu"), "{order}");
    assert!(
        order.contains("hhhlhhhlllll") || order.contains("hhhlhhhl"),
        "{order}"
    );
    assert!(order.ends_with("bbbb"), "{order}");
}

#[test]
fn a_reliable_backlog_does_not_delay_best_effort() {
    let world = &mut World::new(Limits::default());
    let mut client = bare(world, 1);
    for number in [2, 3] {
        client.topic(
            world,
            number,
            1,
            ["bulk", "fast"][usize::from(number - 2)],
            "T",
        );
        client.writer(world, number);
        client.reader(world, number, 100);
    }
    client.read(world, 2, StreamId::RELIABLE, UNLIMITED);
    client.read(world, 3, StreamId::BEST_EFFORT, UNLIMITED);
    client.acknowledging = false;
    for i in 0..100 {
        client.write(world, 2, &[i; 4]);
        assert!(client.write(world, 3, &[i; 4]).contains(&data(3, &[i; 4])));
    }
}

#[test]
fn limits_on_memory_and_rate_of_a_client() {
    let limits = Limits {
        client_bytes: 100_000,
        sample: 1000,
        datagrams_per_second: 100,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(200));
    let streams = world.agent.snapshot(world.at()).clients[0].bytes;
    assert!((1000..60_000).contains(&streams), "{streams}");
    let mut writes = 0;
    for i in 0..300_u16 {
        world.pass(20 * MS);
        client.write(world, 1, &[i as u8; 900]);
        writes += 1;
        assert!(world.agent.snapshot(world.at()).clients[0].bytes <= 100_000);
    }
    assert_eq!(world.agent.stats().samples_in, writes);
    assert!(world.agent.stats().samples_dropped > 200);
    let before = world.agent.stats();
    for _ in 0..300 {
        client.write_loosely(world, 1, b"much");
    }
    let after = world.agent.stats();
    assert!((50..=101).contains(&(after.samples_in - before.samples_in)));
    assert!(after.rate_limited - before.rate_limited >= 199);
}

fn prioritized() -> AgentConfig {
    AgentConfig {
        rules: vec![TopicRule::new("/urgent", 7)],
        ..AgentConfig::default()
    }
}

/// A link that takes nothing for a while: what was written last can still be what is sent first.
#[test]
fn the_urgent_overtakes_what_waits_for_a_slow_link() {
    let world = &mut World::with(&prioritized());
    let mut client = bare(world, 1);
    for (number, name) in [(2, "rt/bulk"), (3, "rt/urgent")] {
        client.topic(world, number, 1, name, "T");
        client.writer(world, number);
        client.reader(world, number, 50);
        client.read(world, number, StreamId::BEST_EFFORT, UNLIMITED);
    }
    world.agent.hold(|peer| *peer == 1);
    for i in 0..50 {
        client.write_loosely(world, 2, &[i; 4]);
    }
    client.write_loosely(world, 3, b"now!");
    assert_eq!(client.got(world), []);
    world.pass(5 * SECOND);
    assert_eq!(
        client.got(world),
        [],
        "not even signs of life are asked for"
    );
    world.agent.release(world.at(), |peer| *peer == 1);
    world.pass(0);
    let got = payloads(&client.got(world));
    assert_eq!((got.len(), &got[0][..]), (51, &b"now!"[..]));
}

#[test]
fn the_urgent_goes_before_a_backlog_of_other_clients() {
    let world = &mut World::with(&prioritized());
    let mut clients: Vec<Client> = (1..=3).map(|peer| bare(world, peer)).collect();
    for (number, name) in [(2, "rt/bulk"), (3, "rt/urgent")] {
        for client in &mut clients {
            client.topic(world, number, 1, name, "T");
            client.writer(world, number);
        }
    }
    for (at, number) in [(0, 2), (1, 2), (2, 3)] {
        clients[at].reader(world, number, 50);
        clients[at].read(world, number, StreamId::BEST_EFFORT, UNLIMITED);
    }
    world.agent.hold(|_| true);
    for i in 0..20 {
        clients[0].write_loosely(world, 2, &[i; 4]);
    }
    clients[1].write_loosely(world, 3, b"now!");
    world.agent.release(world.at(), |_| true);
    world.pass(0);
    let order: Vec<u32> = world.sent.iter().map(|(peer, _)| *peer).collect();
    assert_eq!(order.len(), 41);
    assert_eq!(order[0], 3, "{order:?}");
    let turns = order[1..].windows(2).filter(|pair| pair[0] == pair[1]);
    assert_eq!(turns.count(), 0, "the others in turn: {order:?}");
}

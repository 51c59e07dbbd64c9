//! Clients that ask for anything that can be asked for, in any order, over transports that stall
//! and break: nothing leaks, nothing spins, and limits hold.

use crate::support::{Client, MS, World};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use replenish_agent::{AgentConfig, Limits, Stats, TopicRule};
use replenish_xrce::framing::{SERIAL_AGENT, Serial, serial_frame, serial_frame_len};
use replenish_xrce::wire::{
    CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, EndpointQos, Entity,
    GroupBinary, ObjectId, ObjectKind, ParticipantBinary, ReadData, ReaderQos, Representation,
    ServiceBinary, StreamId, TopicBinary, WriterQos,
};

const LIMITS: Limits = Limits {
    clients: 3,
    entities: 12,
    sample: 3000,
    client_bytes: 150_000,
    default_depth: 4,
    max_depth: 8,
    calls: 3,
    datagrams_per_second: 0,
    unauthenticated_per_second: 0,
    writer_block_limit: Some(300 * MS),
    silence: 10_000 * MS,
    ..Limits::DEFAULT
};

/// One thing that happens to one client.
#[derive(Clone, Debug)]
enum Deed {
    Create(ObjectKind, u16, u16, u16),
    Delete(ObjectKind, u16),
    Read(ObjectKind, u16, bool, [u16; 4]),
    Write(ObjectKind, u16, usize, bool),
    Acknowledging(bool),
    Hold(bool),
    Gone,
    Wait(u64),
    Login,
}

fn deed() -> impl Strategy<Value = Deed> {
    let kinds = [
        ObjectKind::Participant,
        ObjectKind::Topic,
        ObjectKind::Publisher,
        ObjectKind::Subscriber,
        ObjectKind::DataWriter,
        ObjectKind::DataReader,
        ObjectKind::Requester,
        ObjectKind::Replier,
    ];
    let any_kind = prop::sample::select(kinds.to_vec());
    let reading = prop::sample::select(kinds[5..].to_vec());
    let writing = prop::sample::select(vec![kinds[4], kinds[4], kinds[6], kinds[7]]);
    let few = || prop_oneof![Just(0_u16), 1_u16..5, Just(u16::MAX)];
    prop_oneof![
        4 => (any_kind.clone(), 1_u16..3, 0_u16..16, 0_u16..5)
            .prop_map(|(kind, id, flags, depth)| Deed::Create(kind, id, flags, depth)),
        1 => (any_kind, 1_u16..3).prop_map(|(kind, id)| Deed::Delete(kind, id)),
        3 => (reading, 1_u16..3, any::<bool>(), [few(), few(), few(), few()])
            .prop_map(|(kind, id, reliable, control)| Deed::Read(kind, id, reliable, control)),
        8 => (writing, 1_u16..3, prop_oneof![0_usize..60, Just(2500), Just(3001)], any::<bool>())
            .prop_map(|(kind, id, len, reliable)| Deed::Write(kind, id, len, reliable)),
        1 => any::<bool>().prop_map(Deed::Acknowledging),
        1 => any::<bool>().prop_map(Deed::Hold),
        1 => Just(Deed::Gone),
        3 => (0_u64..400).prop_map(Deed::Wait),
        1 => Just(Deed::Login),
    ]
}

fn entity(kind: ObjectKind, id: u16, flags: u16, depth: u16) -> Entity<'static> {
    let of = |kind| ObjectId::new(id, kind);
    let participant = ObjectId::new(1, ObjectKind::Participant);
    let endpoint = EndpointQos {
        flags,
        depth: Some(depth),
        lifespan_ms: (flags & 4 != 0).then_some(20),
        deadline_ms: (depth == 4).then_some(100),
        user_data: None,
    };
    let group = Representation::Binary(GroupBinary::default());
    let service = Representation::Binary(ServiceBinary {
        service: ["a", "b"][usize::from(id % 2)],
        request_type: "Q",
        reply_type: "R",
        request_topic: None,
        reply_topic: None,
    });
    match kind {
        ObjectKind::Participant => Entity::Participant {
            repr: Representation::Binary(ParticipantBinary::default()),
            domain: 0,
        },
        ObjectKind::Topic => Entity::Topic {
            repr: Representation::Binary(TopicBinary {
                name: ["urgent", "slow"][usize::from(id % 2)],
                type_reference: None,
                type_name: Some("T"),
            }),
            participant,
        },
        ObjectKind::Publisher => Entity::Publisher {
            repr: group,
            participant,
        },
        ObjectKind::Subscriber => Entity::Subscriber {
            repr: group,
            participant,
        },
        ObjectKind::DataWriter => Entity::DataWriter {
            repr: Representation::Binary(DataWriterBinary {
                topic: of(ObjectKind::Topic),
                qos: Some(WriterQos {
                    endpoint,
                    ownership_strength: None,
                }),
            }),
            publisher: of(ObjectKind::Publisher),
        },
        ObjectKind::DataReader => Entity::DataReader {
            repr: Representation::Binary(DataReaderBinary {
                topic: of(ObjectKind::Topic),
                qos: Some(ReaderQos {
                    endpoint,
                    ..ReaderQos::default()
                }),
            }),
            subscriber: of(ObjectKind::Subscriber),
        },
        ObjectKind::Requester => Entity::Requester {
            repr: service,
            participant,
        },
        _ => Entity::Replier {
            repr: service,
            participant,
        },
    }
}

fn carry_out(world: &mut World, client: &mut Client, deed: &Deed, last: &mut Vec<u8>) {
    let peer = client.peer;
    match *deed {
        Deed::Create(kind, id, flags, depth) => {
            let base = client.base(ObjectId::new(id, kind));
            let create = replenish_xrce::wire::Create {
                base,
                mode: CreationMode::REUSE_OR_REPLACE,
                entity: entity(kind, id, flags, depth),
            };
            client.request(world, &create);
        }
        Deed::Delete(kind, id) => drop(client.delete(world, ObjectId::new(id, kind))),
        Deed::Read(kind, id, reliable, [samples, seconds, bytes, pace]) => {
            let read = ReadData {
                base: client.base(ObjectId::new(id, kind)),
                stream: [StreamId::BEST_EFFORT, StreamId::RELIABLE][usize::from(reliable)],
                filter: None,
                control: Some(DeliveryControl {
                    max_samples: samples,
                    max_elapsed_s: seconds,
                    max_bytes_per_second: bytes,
                    min_pace_ms: pace,
                }),
            };
            client.request(world, &read);
        }
        Deed::Write(ObjectKind::Replier, id, len, _) => {
            let payload = [&last[..], &vec![1; len]].concat();
            client.write_to(world, ObjectId::new(id, ObjectKind::Replier), &payload);
        }
        Deed::Write(ObjectKind::DataWriter, id, len, false) if len < 500 => {
            client.write_loosely(world, id, &vec![2; len]);
        }
        Deed::Write(kind, id, len, _) => {
            // Short ones in bursts that fill queues and windows.
            for _ in 0..if len < 10 { 30 } else { 1 } {
                client.write_to(world, ObjectId::new(id, kind), &vec![3; len]);
            }
        }
        Deed::Acknowledging(acknowledging) => client.acknowledging = acknowledging,
        Deed::Hold(true) => world.agent.hold(|at| *at == peer),
        Deed::Hold(false) => world.agent.release(world.at(), |at| *at == peer),
        Deed::Gone | Deed::Login => {
            if matches!(deed, Deed::Gone) {
                world.agent.gone(|at| *at == peer);
            }
            world.pass(500 * MS); // a log-in that is sooner may be a late one
            world.take(peer); // for the one before
            *client = Client::open(world, peer, peer as u8);
            set_up(world, client);
        }
        Deed::Wait(milliseconds) => world.pass(milliseconds * MS),
    }
    for got in client.got(world) {
        if let crate::support::Got::Data(id, bytes) = got
            && id.kind() == Ok(ObjectKind::Replier)
        {
            *last = bytes[..24].to_vec();
        }
    }
}

/// A client's first requests: everything that the deeds are about, in a form that works.
fn set_up(world: &mut World, client: &mut Client) {
    client.endpoint(world, false, None);
    client.topic(world, 2, 1, "slow", "T");
    for (number, flags) in [(1, 1), (2, 2 | 4 | 8)] {
        for kind in [ObjectKind::DataWriter, ObjectKind::DataReader] {
            let create = Deed::Create(kind, number, flags, 4);
            carry_out(world, client, &create, &mut Vec::new());
        }
    }
    for kind in [ObjectKind::Requester, ObjectKind::Replier] {
        client.service(world, kind, "b");
        client.read_from(world, ObjectId::new(1, kind), DeliveryControl::UNLIMITED);
    }
    for number in [1, 2] {
        let id = ObjectId::new(number, ObjectKind::DataReader);
        client.read_from(world, id, DeliveryControl::UNLIMITED);
    }
}

/// Carries out all deeds on a new agent, and says what has come of it.
fn storm(deeds: &[(usize, Deed)]) -> Result<Stats, TestCaseError> {
    let config = AgentConfig {
        limits: LIMITS,
        rules: vec![TopicRule::new("urgent", 7), TopicRule::new("slow", 1)],
        ..AgentConfig::default()
    };
    let mut world = World::with(&config);
    let mut clients: Vec<Client> = (1..=3)
        .map(|i| Client::open(&mut world, i, i as u8))
        .collect();
    for client in &mut clients {
        set_up(&mut world, client);
    }
    let mut last = vec![0; 24];
    for (which, deed) in deeds {
        carry_out(&mut world, &mut clients[*which], deed, &mut last);
        world.pass(0);
        // Nothing is left undone, or this would be asked for again without end.
        let next = world.agent.next_deadline();
        prop_assert!(next.is_none_or(|at| at > world.now), "{deed:?}");
        let snapshot = world.agent.snapshot(world.at());
        prop_assert!(snapshot.queued_bytes <= LIMITS.memory());
        for client in &snapshot.clients {
            prop_assert!(client.bytes <= LIMITS.client_bytes);
            prop_assert!(client.entities.len() <= LIMITS.entities);
        }
    }
    // Each client's memory is given back.
    world.pass(10_000 * MS);
    let snapshot = world.agent.snapshot(world.at());
    prop_assert_eq!(snapshot.clients.len(), 0);
    prop_assert_eq!((snapshot.topics, snapshot.queued_bytes), (0, 0));
    prop_assert_eq!(world.agent.next_deadline(), None);
    Ok(world.agent.stats())
}

#[test]
fn anything_may_be_asked_for() {
    let config = ProptestConfig {
        cases: 700,
        ..ProptestConfig::default()
    };
    let all = std::cell::RefCell::new(Vec::new());
    let deeds = vec((0_usize..3, deed()), 20..160);
    let result = TestRunner::new(config).run(&deeds, |deeds| {
        all.borrow_mut().push(storm(&deeds)?);
        Ok(())
    });
    result.unwrap();
    // The storm reaches everything that is meant to be reached.
    let sum = |of: fn(&Stats) -> u64| all.borrow().iter().map(of).sum::<u64>();
    for (what, count) in [
        ("samples_out", sum(|s| s.samples_out)),
        ("samples_dropped", sum(|s| s.samples_dropped)),
        ("samples_refused", sum(|s| s.samples_refused)),
        ("samples_expired", sum(|s| s.samples_expired)),
        ("deadlines_missed", sum(|s| s.deadlines_missed)),
        ("qos_mismatches", sum(|s| s.qos_mismatches)),
        ("calls_forgotten", sum(|s| s.calls_forgotten)),
        ("replies_unwanted", sum(|s| s.replies_unwanted)),
        ("held_back", sum(|s| s.held_back)),
        ("clients_lost", sum(|s| s.clients_lost)),
        ("clients_replaced", sum(|s| s.clients_replaced)),
        ("clients_reaped", sum(|s| s.clients_reaped)),
        ("refused", sum(|s| s.refused)),
    ] {
        assert!(count > 0, "{what} in none of the storms");
    }
}

proptest! {
    /// Noise on a line costs frames, never the line: after it, and one frame at most, all is well.
    #[test]
    fn a_line_recovers_from_any_noise(
        noise in vec(prop_oneof![any::<u8>(), Just(0x7e), Just(0x7d)], 0..300),
        message in vec(any::<u8>(), 1..60),
    ) {
        let mut frame = vec![0; serial_frame_len(message.len())];
        let len = serial_frame(1, SERIAL_AGENT, &message, &mut frame).unwrap();
        let mut decoder = Serial::new(SERIAL_AGENT, vec![0; 512]);
        let mut got = 0;
        decoder.push(&noise, |_, _| {});
        for _ in 0..2 {
            decoder.push(&frame[..len], |_, arrived| got += usize::from(arrived == message));
        }
        prop_assert_eq!(got, 2, "a beginning is recognised whatever was before");
    }
}

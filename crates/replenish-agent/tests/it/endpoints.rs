//! Entities and samples: who gets what, how much is kept, in which order it is sent.

use crate::support::{Client, Got, MTU, World, data, payloads, reader};
use replenish_agent::Limits;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    CreationMode, DataReaderBinary, DeliveryControl, Entity, Header, Message, MessageWriter,
    ObjectId, ObjectKind, Representation, Status, StreamId, TopicBinary, WriteData,
};

const UNLIMITED: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);
const READER: ObjectId = ObjectId::new(1, ObjectKind::DataReader);
const PARTICIPANT: ObjectId = ObjectId::new(1, ObjectKind::Participant);

/// A client with topic 1, writer 1 and reader 1 of `depth`.
fn alone(depth: u16) -> (World, Client) {
    let mut world = World::new(Limits::default());
    let mut client = Client::open(&mut world, 1, 1);
    client.endpoint(&mut world, true, Some(depth));
    (world, client)
}

#[test]
fn what_exists_already_is_kept_replaced_or_refused() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    let mut create = |reuse, replace, depth| {
        client.create(
            world,
            READER,
            CreationMode { reuse, replace },
            reader(1, depth),
        )
    };
    assert_eq!(create(false, false, 10), Status::ALREADY_EXISTS);
    assert_eq!(create(true, false, 10), Status::OK_MATCHED);
    assert_eq!(create(true, false, 11), Status::MISMATCH);
    assert_eq!(create(true, true, 10), Status::OK_MATCHED);
    assert_eq!(create(true, true, 11), Status::OK);
    assert_eq!(
        create(true, false, 11),
        Status::OK_MATCHED,
        "the replacement"
    );
    assert_eq!(create(false, true, 11), Status::OK);
}

#[test]
fn a_replaced_reader_starts_without_samples_and_request() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    client.create(world, READER, CreationMode::REPLACE, reader(1, 10));
    assert_eq!(
        client.write(world, 1, b"kept"),
        [],
        "nobody has asked the new one"
    );
    assert_eq!(
        client.read(world, 1, StreamId::RELIABLE, UNLIMITED),
        [data(1, b"kept")]
    );
}

#[test]
fn what_an_entity_belongs_to_must_exist() {
    let mut world = World::new(Limits::default());
    let world = &mut world;
    let mut client = Client::open(world, 1, 1);
    let topic = TopicBinary {
        name: "t",
        type_reference: None,
        type_name: Some("T"),
    };
    let topic = Entity::Topic {
        repr: Representation::Binary(topic),
        participant: PARTICIPANT,
    };
    let id = ObjectId::new(1, ObjectKind::Topic);
    let mode = CreationMode::default();
    assert_eq!(
        client.create(world, id, mode, topic),
        Status::UNKNOWN_REFERENCE
    );
    client.endpoint(world, true, None);
    assert_eq!(
        client.create(world, id, mode, topic),
        Status::ALREADY_EXISTS
    );

    let with = |topic, subscriber| Entity::DataReader {
        repr: Representation::Binary(DataReaderBinary { topic, qos: None }),
        subscriber,
    };
    let subscriber = ObjectId::new(1, ObjectKind::Subscriber);
    let publisher = ObjectId::new(1, ObjectKind::Publisher);
    let nothing = ObjectId::new(2, ObjectKind::Topic);
    for entity in [
        with(nothing, subscriber),
        with(id, publisher),
        with(id, PARTICIPANT),
    ] {
        let status = client.create(world, READER, mode, entity);
        assert_eq!(status, Status::UNKNOWN_REFERENCE, "{entity:?}");
    }
    assert_eq!(
        client.create(world, PARTICIPANT, mode, with(id, subscriber)),
        Status::INVALID_DATA
    );
    assert_eq!(
        client.create(world, READER, mode, with(id, subscriber)),
        Status::OK
    );
}

#[test]
fn descriptions_without_names_are_refused() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    let subscriber = ObjectId::new(1, ObjectKind::Subscriber);
    let id = ObjectId::new(2, ObjectKind::DataReader);
    let mut create = |repr| {
        let entity = Entity::DataReader { repr, subscriber };
        client.create(world, id, CreationMode::default(), entity)
    };
    assert_eq!(
        create(Representation::Reference("")),
        Status::UNKNOWN_REFERENCE
    );
    assert_eq!(
        create(Representation::Xml("<dds></dds>")),
        Status::INVALID_DATA
    );
    assert_eq!(
        create(Representation::Xml("<topic><name>t</name></topic>")),
        Status::INVALID_DATA
    );
    let xml =
        "<dds><data_reader><topic><name>t</name><dataType>T</dataType></topic></data_reader></dds>";
    assert_eq!(create(Representation::Xml(xml)), Status::OK);
}

#[test]
fn xml_says_how_many_samples_are_kept() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    let subscriber = ObjectId::new(1, ObjectKind::Subscriber);
    let xml = "<dds><data_reader><topic><kind>NO_KEY</kind><name>t</name><dataType>T</dataType>\
               <historyQos><kind>KEEP_LAST</kind><depth>2</depth></historyQos></topic>\
               <qos><reliability><kind>RELIABLE</kind></reliability></qos></data_reader></dds>";
    let entity = Entity::DataReader {
        repr: Representation::Xml(xml),
        subscriber,
    };
    let id = ObjectId::new(2, ObjectKind::DataReader);
    assert_eq!(
        client.create(world, id, CreationMode::default(), entity),
        Status::OK
    );
    for i in 0..5 {
        client.write(world, 1, &[i; 4]);
    }
    let got = client.read(world, 2, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(got, [data(2, &[3; 4]), data(2, &[4; 4])]);
}

/// As with eProsima's agents: each entity by itself, and what was made with its help stays.
#[test]
fn deleting_an_entity_deletes_only_that() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    for kind in [
        ObjectKind::Participant,
        ObjectKind::Topic,
        ObjectKind::Publisher,
        ObjectKind::Subscriber,
    ] {
        let id = ObjectId::new(1, kind);
        for expected in [Status::OK, Status::UNKNOWN_REFERENCE] {
            let got = client.delete(world, id);
            assert!(
                matches!(got[..], [Got::Status(_, _, status)] if status == expected),
                "{id:?} {got:?}"
            );
        }
    }
    assert_eq!(client.write(world, 1, b"here"), [data(1, b"here")]);
    assert_eq!(client.writer(world, 1), Status::ALREADY_EXISTS);
    assert_eq!(client.writer(world, 2), Status::UNKNOWN_REFERENCE);
    for kind in [ObjectKind::DataWriter, ObjectKind::DataReader] {
        let got = client.delete(world, ObjectId::new(1, kind));
        assert!(matches!(got[..], [Got::Status(_, _, Status::OK)]));
    }
    let got = client.write(world, 1, b"void");
    assert!(
        matches!(got[..], [Got::Status(_, _, Status::UNKNOWN_REFERENCE)]),
        "{got:?}"
    );
    client.endpoint(world, true, Some(10));
}

#[test]
fn no_more_entities_than_the_limit() {
    let mut world = World::new(Limits {
        entities: 3,
        ..Limits::default()
    });
    let world = &mut world;
    let mut client = Client::open(world, 1, 1);
    for number in 1..=3 {
        assert_eq!(client.participant(world, number, 0), Status::OK);
    }
    assert_eq!(client.participant(world, 4, 0), Status::RESOURCES);
    client.delete(world, ObjectId::new(2, ObjectKind::Participant));
    assert_eq!(client.participant(world, 4, 0), Status::OK);
}

#[test]
fn only_as_many_samples_as_asked_for() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    let two = DeliveryControl {
        max_samples: 2,
        ..DeliveryControl::UNLIMITED
    };
    client.read(world, 1, StreamId::RELIABLE, Some(two));
    let mut got = Vec::new();
    for i in 0..4 {
        got.extend(client.write(world, 1, &[i; 4]));
    }
    assert_eq!(got, [data(1, &[0; 4]), data(1, &[1; 4])]);
    // Without delivery control it is one; the rest waits.
    assert_eq!(
        client.read(world, 1, StreamId::RELIABLE, None),
        [data(1, &[2; 4])]
    );
    assert_eq!(
        client.read(world, 1, StreamId::RELIABLE, UNLIMITED),
        [data(1, &[3; 4])]
    );
    assert_eq!(
        client.read(world, 1, StreamId::RELIABLE, Some(DeliveryControl::CANCEL)),
        []
    );
    assert_eq!(client.write(world, 1, b"quit"), []);
}

#[test]
fn the_last_samples_are_kept_and_the_others_counted() {
    let (mut world, mut client) = alone(3);
    let world = &mut world;
    for i in 0..10 {
        client.write(world, 1, &[i; 4]);
    }
    assert_eq!(world.agent.stats().samples_dropped, 7);
    let got = client.read(world, 1, StreamId::BEST_EFFORT, UNLIMITED);
    assert_eq!(got, [data(1, &[7; 4]), data(1, &[8; 4]), data(1, &[9; 4])]);
    assert_eq!(world.agent.stats().samples_out, 3);
}

#[test]
fn a_client_that_does_not_acknowledge_costs_no_more_than_its_queue() {
    let (mut world, mut client) = alone(5);
    let world = &mut world;
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    client.acknowledging = false;
    let mut got = Vec::new();
    for i in 0..100 {
        got.extend(client.write(world, 1, &[i; 4]));
    }
    // 16 are on their way, 5 wait, the others had to go.
    assert_eq!(payloads(&got).len(), 16);
    assert_eq!(world.agent.stats().samples_dropped, 100 - 16 - 5);
    client.acknowledging = true;
    let after = payloads(&client.acknowledge(world));
    assert_eq!(after, (95..100).map(|i| vec![i; 4]).collect::<Vec<_>>());
}

#[test]
fn a_backlog_of_one_reader_does_not_delay_another() {
    let (mut world, mut client) = alone(200);
    let world = &mut world;
    client.topic(world, 2, 1, "urgent", "T");
    client.writer(world, 2);
    client.reader(world, 2, 10);
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    client.read(world, 2, StreamId::RELIABLE, UNLIMITED);
    client.acknowledging = false;
    for i in 0..100 {
        client.write(world, 1, &[i; 4]);
    }
    client.write(world, 2, b"now!");
    let got = client.got(world);
    assert!(
        !payloads(&got).contains(&b"now!".to_vec()),
        "the stream is full"
    );
    client.acknowledging = true;
    let got = client.acknowledge(world);
    let at = got.iter().position(|got| *got == data(2, b"now!"));
    assert!(at.is_some_and(|at| at <= 1), "{at:?} of {}", got.len());
    assert_eq!(payloads(&got).len(), 100 - 16 + 1);
}

#[test]
fn a_long_sample_goes_out_in_fragments_and_a_too_long_one_is_dropped() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    let long: Vec<u8> = (0..4200_u32).map(|i| (i * 7 % 251) as u8).collect();
    assert_eq!(client.write(world, 1, &long), [data(1, &long)]);

    // A best-effort stream has no fragments.
    client.read(world, 1, StreamId::BEST_EFFORT, UNLIMITED);
    let refused = world.agent.stats().samples_refused;
    assert_eq!(client.write(world, 1, &long), []);
    assert_eq!(world.agent.stats().samples_refused, refused + 1);
    assert_eq!(client.write(world, 1, b"short"), [data(1, b"short")]);
}

#[test]
fn no_datagram_is_longer_than_client_and_limit_allow() {
    // The client's figure, the longest datagram, the number of datagrams for 5000 bytes.
    for (mtu, longest, count) in [
        (MTU, usize::from(MTU), 10),
        (64, 64, 16),
        (u16::MAX, 1000, 6),
    ] {
        let mut world = World::new(Limits {
            message: 1000,
            ..Limits::default()
        });
        let world = &mut world;
        let mut client = Client::new(1, 1);
        client.mtu = mtu;
        client.login(world);
        client.endpoint(world, true, Some(10));
        client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
        client.acknowledging = false;
        let base = client.base(ObjectId::new(1, ObjectKind::DataWriter));
        let payload = &[7; 5000];
        let (session, key) = (client.session, client.key);
        let header = Header::new(session, StreamId::BEST_EFFORT, SeqNum(0), key);
        let mut buf = [0; 6000];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        message.push(&WriteData { base, payload }).unwrap();
        world.deliver(1, message.finish());
        let sent = world.take(1);
        assert_eq!(sent.len(), count, "mtu {mtu}; 16 may be under way");
        assert_eq!(sent.iter().map(Vec::len).max(), Some(longest), "mtu {mtu}");
        assert!(sent.iter().all(|datagram| Message::parse(datagram).is_ok()));
    }
}

#[test]
fn streams_are_limited_and_none_is_not_one() {
    let (mut world, mut client) = alone(10);
    let world = &mut world;
    let statuses: Vec<Option<Status>> = [0x00, 0x01, 0x02, 0x03, 0x04, 0x81, 0x82, 0x01]
        .map(
            |stream| match client.read(world, 1, StreamId(stream), UNLIMITED)[..] {
                [] => None,
                [Got::Status(_, _, status)] => Some(status),
                ref other => panic!("{other:?}"),
            },
        )
        .to_vec();
    let refused = [
        Some(Status::INVALID_DATA),
        None,
        None,
        None,
        None,
        None,
        Some(Status::RESOURCES),
        None,
    ];
    assert_eq!(
        statuses, refused,
        "with 0x80 for the statuses there are six"
    );
}

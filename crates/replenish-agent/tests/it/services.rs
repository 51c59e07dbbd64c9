//! Requesters and repliers: who gets which request, and who gets the reply.

use crate::support::{Client, Got, World};
use replenish_agent::{AgentConfig, Limits, Profiles};
use replenish_xrce::wire::{
    CreationMode, DeliveryControl, Entity, ObjectId, ObjectKind, Representation, RequestId,
    ServiceBinary, Status, StreamId,
};

const REQUESTER: ObjectId = ObjectId::new(1, ObjectKind::Requester);
const REPLIER: ObjectId = ObjectId::new(1, ObjectKind::Replier);
const ALL: DeliveryControl = DeliveryControl::UNLIMITED;

/// A client with a requester or replier that reads.
fn client(world: &mut World, peer: u32, kind: ObjectKind, name: &str) -> Client {
    let mut client = Client::open(world, peer, peer as u8);
    client.participant(world, 1, 0);
    assert_eq!(client.service(world, kind, name), Status::OK);
    assert_eq!(client.read_from(world, ObjectId::new(1, kind), ALL), []);
    client
}

/// The identity and the contents of the requests that a replier got.
fn requests(got: &[Got]) -> Vec<(Vec<u8>, Vec<u8>)> {
    let split = |got: &Got| match got {
        Got::Data(REPLIER, bytes) => (bytes[..24].to_vec(), bytes[24..].to_vec()),
        other => panic!("{other:?}"),
    };
    got.iter().map(split).collect()
}

/// DATA for a requester: which request, and the reply.
fn reply(request: RequestId, payload: &[u8]) -> Got {
    let [r0, r1] = request.0.to_be_bytes();
    let [o0, o1] = REQUESTER.to_bytes();
    Got::Data(REQUESTER, [&[r0, r1, o0, o1], payload].concat())
}

#[test]
fn replies_find_their_requests_in_any_order_among_several_requesters() {
    let world = &mut World::new(Limits::default());
    let mut server = client(world, 1, ObjectKind::Replier, "add");
    let mut one = client(world, 2, ObjectKind::Requester, "add");
    let mut two = client(world, 3, ObjectKind::Requester, "add");
    let mut other = client(world, 4, ObjectKind::Replier, "subtract");
    let (first, _) = one.write_to(world, REQUESTER, b"1+1");
    let (second, _) = two.write_to(world, REQUESTER, b"2+2");
    let (third, _) = one.write_to(world, REQUESTER, b"3+3");
    let asked = requests(&server.got(world));
    let texts: Vec<&[u8]> = asked.iter().map(|(_, text)| &text[..]).collect();
    assert_eq!(texts, [b"1+1", b"2+2", b"3+3"]);
    assert_eq!(other.got(world), []);
    for at in [2, 0, 1] {
        let (identity, text) = &asked[at];
        server.write_to(world, REPLIER, &[&identity[..], b"=", text].concat());
    }
    assert_eq!(
        one.got(world),
        [reply(third, b"=3+3"), reply(first, b"=1+1")]
    );
    assert_eq!(two.got(world), [reply(second, b"=2+2")]);
    assert_eq!(world.agent.stats().replies_unwanted, 0);
}

#[test]
fn only_the_first_reply_counts_and_unknown_ones_are_counted() {
    let world = &mut World::new(Limits::default());
    let mut server = client(world, 1, ObjectKind::Replier, "s");
    let mut caller = client(world, 2, ObjectKind::Requester, "s");
    let (request, _) = caller.write_to(world, REQUESTER, b"hi");
    let (identity, _) = requests(&server.got(world)).remove(0);
    let mut forged = identity.clone();
    forged[5] ^= 1;
    for identity in [&forged, &identity, &identity] {
        server.write_to(world, REPLIER, identity);
    }
    assert_eq!(caller.got(world), [reply(request, b"")]);
    assert_eq!(world.agent.stats().replies_unwanted, 2);
    server.write_to(world, REPLIER, b"too short");
    assert_eq!(world.agent.stats().malformed, 1);
}

#[test]
fn a_requester_that_starts_again_does_not_get_the_replies_of_its_predecessor() {
    let world = &mut World::new(Limits::default());
    let mut server = client(world, 1, ObjectKind::Replier, "s");
    let mut caller = client(world, 2, ObjectKind::Requester, "s");
    caller.write_to(world, REQUESTER, b"old");
    let (old, _) = requests(&server.got(world)).remove(0);
    caller.delete(world, REQUESTER);
    caller.service(world, ObjectKind::Requester, "s");
    caller.read_from(world, REQUESTER, ALL);
    let (request, _) = caller.write_to(world, REQUESTER, b"new");
    let (new, _) = requests(&server.got(world)).remove(0);
    assert_ne!(old, new);
    server.write_to(world, REPLIER, &[&old[..], b"old"].concat());
    server.write_to(world, REPLIER, &[&new[..], b"new"].concat());
    assert_eq!(caller.got(world), [reply(request, b"new")]);
}

#[test]
fn more_requests_than_are_remembered() {
    let limits = Limits {
        calls: 3,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut server = client(world, 1, ObjectKind::Replier, "s");
    let mut caller = client(world, 2, ObjectKind::Requester, "s");
    let ids: Vec<RequestId> = (0..5_u8)
        .map(|i| caller.write_to(world, REQUESTER, &[i]).0)
        .collect();
    assert_eq!(world.agent.stats().calls_forgotten, 2);
    for (identity, text) in requests(&server.got(world)) {
        server.write_to(world, REPLIER, &[identity, text].concat());
    }
    let expected: Vec<Got> = (2..5_u8)
        .map(|i| reply(ids[usize::from(i)], &[i]))
        .collect();
    assert_eq!(caller.got(world), expected);
}

/// Every kind by reference: from profiles, and from nothing but the name.
#[test]
fn entities_by_reference() {
    let refs = r#"<profiles>
        <participant profile_name="node"><domainId>7</domainId></participant>
        <topic profile_name="chat"><name>rt/chat</name><dataType>Text</dataType></topic>
        <data_reader profile_name="ears"><topic><name>rt/chat</name><dataType>Text</dataType>
        </topic></data_reader>
        <replier profile_name="adder" service_name="add" request_type="Q" reply_type="R"/>
        </profiles>"#;
    let config = AgentConfig {
        profiles: Profiles::parse(refs).unwrap().strict(),
        ..AgentConfig::default()
    };
    let id = |kind| ObjectId::new(1, kind);
    let create = |world: &mut World, client: &mut Client, name: &str| {
        let participant = id(ObjectKind::Participant);
        [
            (
                "node",
                Entity::Participant {
                    repr: Representation::Reference(if name.is_empty() { "node" } else { name }),
                    domain: 255,
                },
            ),
            (
                "chat",
                Entity::Topic {
                    repr: Representation::Reference(if name.is_empty() { "chat" } else { name }),
                    participant,
                },
            ),
            (
                "",
                Entity::Subscriber {
                    repr: Representation::Reference("whatever"),
                    participant,
                },
            ),
            (
                "ears",
                Entity::DataReader {
                    repr: Representation::Reference(if name.is_empty() { "ears" } else { name }),
                    subscriber: id(ObjectKind::Subscriber),
                },
            ),
            (
                "adder",
                Entity::Replier {
                    repr: Representation::Reference(if name.is_empty() { "adder" } else { name }),
                    participant,
                },
            ),
        ]
        .map(|(_, entity)| {
            let object = id(entity.kind());
            client.create(world, object, CreationMode::REUSE_OR_REPLACE, entity)
        })
    };
    let world = &mut World::with(&config);
    let mut one = Client::open(world, 1, 1);
    assert_eq!(create(world, &mut one, ""), [Status::OK; 5]);
    assert_eq!(create(world, &mut one, ""), [Status::OK_MATCHED; 5]);
    assert_eq!(
        create(world, &mut one, "nobody")[0],
        Status::UNKNOWN_REFERENCE
    );
    let snapshot = world.agent.snapshot(world.at());
    let topics: Vec<(i16, &str)> = snapshot.clients[0]
        .entities
        .iter()
        .map(|entity| (entity.domain, &entity.name[..]))
        .collect();
    // In the order of their ids, of which the last digit is the kind.
    assert_eq!(
        topics,
        [
            (7, "node"),
            (7, "rt/chat"),
            (7, ""),
            (7, "rt/chat"),
            (7, "add_Request")
        ]
    );

    let world = &mut World::new(Limits::default());
    let mut two = Client::open(world, 2, 2);
    assert_eq!(create(world, &mut two, "any"), [Status::OK; 5]);
}

/// The requests of micro-ROS: topics of its own names, in binary form or as XML, which are the
/// same.
#[test]
fn topics_of_a_service_can_be_named() {
    let world = &mut World::new(Limits::default());
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    let participant = ObjectId::new(1, ObjectKind::Participant);
    let binary = Entity::Replier {
        repr: Representation::Binary(ServiceBinary {
            service: "/add",
            request_type: "Q",
            reply_type: "R",
            request_topic: Some("rq/addRequest"),
            reply_topic: Some("rr/addReply"),
        }),
        participant,
    };
    let xml = "<dds><replier profile_name=\"p\" service_name=\"/add\" request_type=\"Q\" \
               reply_type=\"R\"><request_topic_name>rq/addRequest</request_topic_name>\
               <reply_topic_name>rr/addReply</reply_topic_name></replier></dds>";
    let xml = Entity::Replier {
        repr: Representation::Xml(xml),
        participant,
    };
    let mut create = |world: &mut World, entity| {
        client.create(world, REPLIER, CreationMode::REUSE_OR_REPLACE, entity)
    };
    assert_eq!(create(world, binary), Status::OK);
    assert_eq!(create(world, xml), Status::OK_MATCHED);
    // A plain data writer's samples are no requests; a plain reader sees what requesters send.
    client.topic(world, 2, 1, "rq/addRequest", "Q");
    client.writer(world, 2);
    client.reader(world, 2, 5);
    client.read(world, 2, StreamId::RELIABLE, Some(ALL));
    client.read_from(world, REPLIER, ALL);
    assert_eq!(
        client.write(world, 2, b"what"),
        [crate::support::data(2, b"what")]
    );
}

//! Every way to refuse a topic, a service, a node or a log-in is reported with the client, the name
//! in ROS's words, and the reason.

use crate::support::{Client, Got, World};
use replenish_agent::{AccessList, AgentConfig, Limits, Refusal};
use replenish_xrce::wire::{
    CreationMode, Entity, ObjectId, ObjectKind, Representation, Status, TopicBinary,
};

const STRING: &str = "std_msgs::msg::dds_::String_";

/// The last refusal.
fn last(world: &World) -> Refusal {
    let refusals = world.agent.snapshot(world.at()).refusals;
    refusals.last().cloned().expect("there is one")
}

/// The topic entity alone.
fn topic(world: &mut World, client: &mut Client, number: u16, name: &str) -> Status {
    let repr = Representation::Binary(TopicBinary {
        name,
        type_reference: None,
        type_name: Some(STRING),
    });
    let participant = ObjectId::new(1, ObjectKind::Participant);
    let id = ObjectId::new(number, ObjectKind::Topic);
    let entity = Entity::Topic { repr, participant };
    client.create(world, id, CreationMode::default(), entity)
}

fn assert_refused(refusal: &Refusal, (id, name, type_name): (&str, &str, &str), why: &str) {
    assert_eq!(refusal.key, "01010101", "{refusal:?}");
    let found = (&*refusal.id, &*refusal.name, &*refusal.type_name);
    assert_eq!(found, (id, name, type_name), "{refusal:?}");
    assert!(refusal.reason.ends_with(why), "{refusal:?}");
}

#[test]
fn what_meets_a_limit_is_named() {
    let limits = Limits {
        entities: 2,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    assert_eq!(topic(world, &mut client, 1, "rt/a"), Status::OK);
    let chatter = ("0022", "/chatter", "std_msgs/msg/String");
    assert_eq!(
        topic(world, &mut client, 2, "rt/chatter"),
        Status::RESOURCES
    );
    assert_refused(&last(world), chatter, "limits.entities = 2");

    let limits = Limits {
        client_bytes: 400_000,
        entities: 1000,
        datagrams_per_second: 0,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    let topics = (3..1000).find(|n| topic(world, &mut client, *n, "rt/b") != Status::OK);
    assert!(topics.is_some());
    let refusal = last(world);
    assert_eq!(refusal.name, "/b");
    assert!(
        refusal.reason.ends_with("limits.client_bytes = 400000"),
        "{refusal:?}"
    );
}

#[test]
fn what_the_access_list_does_not_allow_is_named() {
    let list = "[[client]]\nkey = \"01010101\"\nwrite = []\nread = []";
    let config = AgentConfig {
        access: Some(AccessList::parse(list).unwrap()),
        ..AgentConfig::default()
    };
    let world = &mut World::with(&config);
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    client.topic(world, 1, 1, "rt/chatter", STRING);
    assert_eq!(client.writer(world, 1), Status::DENIED);
    let why = "the access list does not have its topic";
    assert_refused(
        &last(world),
        ("0015", "/chatter", "std_msgs/msg/String"),
        why,
    );
    // A key that is not listed has no topic.
    assert_eq!(Client::new(2, 2).login(world), [Got::Agent(Status::DENIED)]);
    let refusals = world.agent.snapshot(world.at()).refusals;
    let of_key = refusals.iter().find(|r| r.key == "02020202").unwrap();
    assert_eq!((&*of_key.id, &*of_key.name), ("", ""));
    assert!(
        of_key.reason.ends_with("does not have its key"),
        "{of_key:?}"
    );
}

#[test]
fn what_cannot_cross_to_dds_is_named() {
    let world = &mut World::new(Limits::default());
    world.agent = replenish_agent::AgentCore::new(Limits::default()).bridged(0, 16);
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    for (number, ty) in [(1, "std_msgs::msg::dds_::Int32_"), (2, STRING)] {
        client.topic(world, number, 1, "rt/chatter", ty);
    }
    assert_eq!(client.writer(world, 1), Status::OK);
    assert_eq!(client.writer(world, 2), Status::INCOMPATIBLE);
    let chatter = ("0025", "/chatter", "std_msgs/msg/String");
    let why = "types of a topic name in DDS while endpoints use it = 1";
    assert_refused(&last(world), chatter, why);

    client.topic(world, 3, 1, "rt/b", STRING);
    assert_eq!(client.writer(world, 3), Status::OK);
    client.topic(world, 4, 1, "rt/c", STRING);
    assert_eq!(client.writer(world, 4), Status::RESOURCES);
    let why = "topic names of one client in DDS = 2";
    assert_refused(&last(world), ("0045", "/c", "std_msgs/msg/String"), why);
    assert_eq!(
        client.service(world, ObjectKind::Replier, "add"),
        Status::RESOURCES
    );
    assert_refused(&last(world), ("0018", "add_Request", "Q"), why);
}

/// A flood of refused log-ins does not push out the names.
#[test]
fn a_full_table_is_reported_and_hides_nothing() {
    let limits = Limits {
        clients: 1,
        entities: 2,
        unauthenticated_per_second: 0,
        ..Limits::default()
    };
    let world = &mut World::new(limits);
    let mut client = Client::open(world, 1, 1);
    client.participant(world, 1, 0);
    assert_eq!(topic(world, &mut client, 1, "rt/a"), Status::OK);
    assert_eq!(topic(world, &mut client, 2, "rt/b"), Status::RESOURCES);
    for key in 2..=200 {
        let full = [Got::Agent(Status::RESOURCES)];
        assert_eq!(Client::new(key.into(), key).login(world), full);
    }
    let refusals = world.agent.snapshot(world.at()).refusals;
    assert_eq!(refusals.len(), 65);
    assert_refused(&refusals[64], ("0022", "/b", "std_msgs/msg/String"), "= 2");
    let full = &refusals[63];
    assert_eq!((&*full.key, &*full.id), ("c8c8c8c8", ""));
    assert!(
        full.reason.ends_with("limits.clients = 1 are there"),
        "{full:?}"
    );
}

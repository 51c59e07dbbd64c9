//! The access list: who may log in, from where, and with which topics.

use crate::support::{Client, Got, World, data};
use replenish_agent::{AccessList, AgentConfig, AgentCore};
use replenish_xrce::wire::{DeliveryControl, ObjectKind, Status, StreamId};
use std::net::{IpAddr, Ipv4Addr};

const ALL: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);

/// A world with this list; peer n is at 10.0.0.n, and peer 0 on a serial line.
fn world(list: &str) -> World {
    let access = Some(AccessList::parse(list).unwrap());
    let config = AgentConfig {
        access,
        ..AgentConfig::default()
    };
    let mut world = World::with(&config);
    let host = |peer: &u32| -> Option<IpAddr> {
        (*peer > 0).then(|| Ipv4Addr::from_bits((10 << 24) + peer).into())
    };
    world.agent = AgentCore::with(&config).hosts(host);
    world
}

fn log_in(world: &mut World, peer: u32, key: u8) -> Vec<Got> {
    Client::new(peer, key).login(world)
}

const OK: [Got; 1] = [Got::Agent(Status::OK)];
const DENIED: [Got; 1] = [Got::Agent(Status::DENIED)];

#[test]
fn only_listed_clients_log_in_and_only_from_listed_places() {
    let world = &mut world(
        r#"
        [[client]]
        key = "01010101"
        from = ["10.0.0.0/29"]

        [[client]]
        key = "02020202"

        [[client]]
        key = "*"
        from = ["serial"]
        "#,
    );
    assert_eq!(log_in(world, 7, 1), OK);
    assert_eq!(
        log_in(world, 8, 1),
        DENIED,
        "before it is asked whether it moved"
    );
    assert_eq!(log_in(world, 8, 2), OK);
    assert_eq!(log_in(world, 9, 3), DENIED);
    assert_eq!(log_in(world, 0, 3), OK);
    let stats = world.agent.stats();
    assert_eq!((stats.clients, stats.denied, stats.takeovers), (3, 2, 0));
}

#[test]
fn topics_are_written_and_read_as_listed() {
    let world = &mut world(
        r#"
        [[client]]
        key = "01010101"
        write = ["t", "/add"]
        read = ["/add"]

        [[client]]
        key = "02020202"
        write = []
        "#,
    );
    let mut talker = Client::open(world, 1, 1);
    talker.endpoint(world, true, None);
    assert_eq!(talker.reader(world, 1, 4), Status::DENIED);
    talker.topic(world, 2, 1, "other", "T");
    assert_eq!(talker.writer(world, 2), Status::DENIED);
    let service = |world: &mut World, client: &mut Client, kind| client.service(world, kind, "s");
    for kind in [ObjectKind::Requester, ObjectKind::Replier] {
        assert_eq!(service(world, &mut talker, kind), Status::DENIED);
    }
    let mut listener = Client::open(world, 2, 2);
    listener.endpoint(world, false, Some(4));
    assert_eq!(listener.writer(world, 1), Status::DENIED);
    listener.read(world, 1, StreamId::RELIABLE, ALL);
    talker.write(world, 1, b"may");
    assert_eq!(listener.got(world), [data(1, b"may")]);
}

#[test]
fn a_client_s_own_limits_are_at_most_those_of_all() {
    let list =
        "[[client]]\nkey = \"01010101\"\nentities = 2\n[[client]]\nkey = \"*\"\nentities = 4096";
    let world = &mut world(list);
    for (key, most) in [(1, 2), (2, 128)] {
        let mut client = Client::open(world, key.into(), key);
        let all =
            (1..=200).take_while(|number| client.participant(world, *number, 0) == Status::OK);
        assert_eq!(all.count(), most);
    }
}

#[test]
fn a_new_list_ends_what_it_does_not_allow_and_nothing_else() {
    let world = &mut world("[[client]]\nkey = \"*\"");
    let mut clients: Vec<Client> = (1..=3).map(|n| Client::open(world, n, n as u8)).collect();
    for client in &mut clients {
        client.endpoint(world, true, Some(4));
        client.read(world, 1, StreamId::RELIABLE, ALL);
    }
    let list = r#"
        [[client]]
        key = "01010101"
        [[client]]
        key = "02020202"
        read = []
    "#;
    let at = world.at();
    let list = AccessList::parse(list).unwrap();
    world.agent.set_access(at, Some(list));
    let left = world.agent.snapshot(world.at()).clients;
    let left: Vec<&str> = left.iter().map(|client| &*client.key).collect();
    assert_eq!(
        left,
        ["01010101"],
        "2 reads what it may not, 3 is not listed"
    );
    assert_eq!(world.agent.stats().denied, 2);
    assert_eq!(clients[0].write(world, 1, b"stays"), [data(1, b"stays")]);
    assert_eq!(log_in(world, 3, 3), DENIED);
    assert_eq!(log_in(world, 2, 2), OK);

    let at = world.at();
    world.agent.set_access(at, None);
    assert_eq!(log_in(world, 3, 3), OK);
}

//! Sessions: who is served, who is replaced, who is forgotten.

use crate::support::{Client, Got, MS, World, data, payloads};
use replenish_agent::Limits;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    AckNack, ClientKey, Delete, DeliveryControl, Header, MessageWriter, ObjectId, ObjectKind,
    SessionId, Status, StreamId, WriteData,
};

const UNLIMITED: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);

fn world() -> World {
    World::new(Limits::default())
}

#[test]
fn two_clients_talk_and_a_third_elsewhere_hears_nothing() {
    let world = &mut world();
    let mut ping = Client::open(world, 1, 1);
    let mut pong = Client::open(world, 2, 2);
    let mut stranger = Client::open(world, 3, 3);
    ping.endpoint(world, true, None);
    pong.endpoint(world, false, Some(10));
    assert_eq!(stranger.participant(world, 1, 7), Status::OK);
    stranger.topic(world, 1, 1, "t", "T");
    assert_eq!(stranger.reader(world, 1, 10), Status::OK);
    assert_eq!(pong.read(world, 1, StreamId::RELIABLE, UNLIMITED), []);
    assert_eq!(stranger.read(world, 1, StreamId::RELIABLE, UNLIMITED), []);

    for i in 0..40 {
        assert_eq!(ping.write(world, 1, &[i, 0, 0, 0]), []);
        assert_eq!(pong.got(world), [data(1, &[i, 0, 0, 0])]);
    }
    assert_eq!(stranger.got(world), [], "domain 7 is another world");
}

#[test]
fn the_newer_of_two_clients_with_one_key_wins_if_the_older_is_silent() {
    let world = &mut world();
    let mut old = Client::open(world, 1, 1);
    old.endpoint(world, true, Some(10));
    old.read(world, 1, StreamId::RELIABLE, UNLIMITED);

    let mut new = Client::new(2, 1);
    assert_eq!(new.login(world), [], "the old one is asked first");
    world.pass(750 * MS);
    assert_eq!(new.login(world), [Got::Agent(Status::OK)]);
    assert_eq!(world.agent.stats().clients, 1);
    assert_eq!(world.agent.stats().takeovers, 1);
    assert_eq!(world.agent.stats().clients_replaced, 1);

    world.take(1); // the questions
    let before = world.agent.stats().no_session;
    assert_eq!(old.write(world, 1, b"gone"), [], "not even acknowledged");
    assert_eq!(world.agent.stats().no_session, before + 1);
    new.endpoint(world, true, Some(10));
    new.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(new.write(world, 1, b"new!"), [data(1, b"new!")]);
    assert_eq!(old.got(world), []);
}

#[test]
fn a_client_that_starts_again_begins_with_nothing() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    world.pass(500 * MS);

    let mut again = Client::new(1, 1);
    assert_eq!(again.login(world), [Got::Agent(Status::OK)]);
    again.endpoint(world, true, Some(10)); // with sequence numbers from 0, and no ALREADY_EXISTS
    again.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(again.write(world, 1, b"back"), [data(1, b"back")], "once");
}

#[test]
fn a_log_in_that_the_network_repeats_resets_nothing() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    world.pass(20 * MS);
    assert_eq!(client.login(world), [Got::Agent(Status::OK)]);
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(client.write(world, 1, b"here"), [data(1, b"here")]);
}

/// Found by the fuzz target `session`: the second try of a log-in that came 0.1 to 0.5 s after the
/// first one emptied the session, and its client waited for answers for ever.
#[test]
fn a_log_in_that_was_sent_twice_and_comes_late_resets_nothing() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    world.pass(MS);
    client.endpoint(world, true, Some(10));
    for _ in 0..3 {
        world.pass(110 * MS);
        assert_eq!(client.login(world), [], "late");
    }
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(client.write(world, 1, b"here"), [data(1, b"here")]);
    // One that has started again tries again, and has its session half a second after the first.
    world.pass(170 * MS);
    let mut again = Client::new(1, 1);
    assert_eq!(again.login(world), [Got::Agent(Status::OK)]);
}

#[test]
fn a_log_in_that_comes_late_does_not_undo_the_one_after_it() {
    let world = &mut world();
    let mut late = Client::new(1, 1);
    assert_eq!(late.login(world), [Got::Agent(Status::OK)]);
    let mut client = Client::new(1, 1);
    client.session = SessionId(0x82);
    assert_eq!(client.login(world), [Got::Agent(Status::OK)]);
    world.pass(20 * MS);
    assert_eq!(late.login(world), [], "the network repeats the first one");
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(client.write(world, 1, b"here"), [data(1, b"here")]);
}

#[test]
fn an_agent_that_starts_again_knows_nobody_until_they_log_in() {
    let mut before = world();
    let mut client = Client::open(&mut before, 1, 1);
    client.endpoint(&mut before, true, Some(10));

    let world = &mut world();
    assert_eq!(client.write(world, 1, b"lost"), [], "silence");
    assert_eq!(world.agent.stats().no_session, 1);
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(client.write(world, 1, b"back"), [data(1, b"back")]);
}

#[test]
fn log_out_is_answered_and_ends_the_session() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    let mut writer = Client::open(world, 2, 2);
    client.endpoint(world, false, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    writer.endpoint(world, true, None);

    let base = client.base(ObjectId::CLIENT);
    let ok = Got::Status(base.request, ObjectId::CLIENT, Status::OK);
    assert_eq!(client.control(world, &Delete { base }), [ok]);
    assert_eq!(world.agent.stats().clients, 1);
    writer.write(world, 1, b"late");
    assert_eq!(client.got(world), []);
    assert_eq!(
        client.control(world, &Delete { base }),
        [],
        "there is no session any more"
    );
}

#[test]
fn the_key_in_the_header_must_be_the_right_one() {
    let world = &mut world();
    let mut client = Client::new(1, 1);
    client.session = SessionId(0x01);
    assert_eq!(client.login(world), [Got::Agent(Status::OK)]);
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    assert_eq!(client.write(world, 1, b"mine"), [data(1, b"mine")]);

    client.key = ClientKey([9; 4]);
    assert_eq!(client.write(world, 1, b"not!"), []);
    assert_eq!(world.agent.stats().no_session, 1);
}

#[test]
fn one_address_can_have_two_sessions() {
    let world = &mut world();
    let mut a = Client::open(world, 1, 1);
    a.endpoint(world, true, None);
    let mut b = Client::new(1, 2);
    b.session = SessionId(0x82);
    assert_eq!(b.login(world), [Got::Agent(Status::OK)]);
    b.endpoint(world, false, Some(10));
    b.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    let header = Header::new(a.session, StreamId::RELIABLE, SeqNum(5), a.key);
    assert_eq!(header.session.header_len(), 4);
    world.sent.clear();
    let base = a.base(ObjectId::new(1, ObjectKind::DataWriter));
    let mut buf = [0; 64];
    let mut message = MessageWriter::new(&mut buf, &header).unwrap();
    message
        .push_padded(&WriteData {
            base,
            payload: b"both",
        })
        .unwrap();
    world.deliver(1, message.finish());
    // The sample goes to session 0x82; once that has acknowledged it, so does the agent, to 0x81.
    let sessions = |world: &mut World| -> Vec<u8> {
        let datagrams = world.take(1);
        datagrams.iter().map(|bytes| bytes[0]).collect()
    };
    assert_eq!(sessions(world), [0x82]);
    let header = Header::new(b.session, StreamId::NONE, SeqNum(0), b.key);
    let mut message = MessageWriter::new(&mut buf, &header).unwrap();
    let (first_unacked, missing) = (b.expects().plus(1), 0);
    let stream = StreamId::RELIABLE;
    let ack = AckNack {
        first_unacked,
        missing,
        stream,
    };
    message.push_padded(&ack).unwrap();
    world.deliver(1, message.finish());
    assert_eq!(sessions(world), [0x81]);
}

#[test]
fn no_more_clients_than_the_limit() {
    let world = &mut World::new(Limits {
        clients: 2,
        ..Limits::default()
    });
    let mut a = Client::open(world, 1, 1);
    Client::open(world, 2, 2);
    let mut c = Client::new(3, 3);
    assert_eq!(c.login(world), [Got::Agent(Status::RESOURCES)]);
    let base = a.base(ObjectId::CLIENT);
    a.control(world, &Delete { base });
    assert_eq!(c.login(world), [Got::Agent(Status::OK)]);
}

#[test]
fn log_ins_that_make_no_sense_are_refused() {
    let world = &mut world();
    let mut keyless = Client::new(1, 0);
    assert_eq!(keyless.login(world), [Got::Agent(Status::INVALID_DATA)]);
    assert_eq!(world.agent.stats().refused, 1);
    assert_eq!(world.agent.stats().clients, 0);
}

#[test]
fn a_silent_client_is_asked_twice_and_then_forgotten() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, false, Some(10));
    let next = SeqNum(5); // five statuses were acknowledged
    let probe = [Got::Heartbeat(next, next.previous())];
    client.acknowledging = false;

    world.pass(10 * MS); // when a heartbeat would have been due
    assert_eq!(world.agent.next_deadline(), Some(10_000 * MS));
    world.pass(9_989 * MS);
    assert_eq!(client.got(world), []);
    world.pass(MS);
    assert_eq!(client.got(world), probe);
    world.pass(10_000 * MS);
    assert_eq!(client.got(world), probe);
    world.pass(9_999 * MS);
    assert_eq!(world.agent.stats().clients, 1);
    world.pass(MS);
    assert_eq!(world.agent.stats().clients, 0);
    assert_eq!(world.agent.stats().clients_reaped, 1);
    assert_eq!(world.agent.next_deadline(), None);
}

#[test]
fn a_client_that_answers_stays() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    for _ in 0..20 {
        world.pass(10_000 * MS);
        assert_eq!(client.got(world).len(), 1, "asked, and answered");
    }
    assert_eq!(payloads(&client.write(world, 1, b"here")), [b"here"]);
}

#[test]
fn unacknowledged_samples_are_announced_again_and_again() {
    let world = &mut world();
    let mut client = Client::open(world, 1, 1);
    client.endpoint(world, true, Some(10));
    client.read(world, 1, StreamId::RELIABLE, UNLIMITED);
    client.acknowledging = false;
    assert_eq!(payloads(&client.write(world, 1, b"seen")), [b"seen"]);
    let mut heartbeats = 0;
    for _ in 0..100 {
        world.pass(10 * MS);
        for got in client.got(world) {
            assert_eq!(got, Got::Heartbeat(SeqNum(6), SeqNum(6)));
            heartbeats += 1;
        }
    }
    assert!((9..=18).contains(&heartbeats), "{heartbeats} in a second");
    client.acknowledge(world);
    world.pass(1000 * MS);
    assert_eq!(client.got(world), []);
}

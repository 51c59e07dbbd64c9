//! Datagrams with a forged source, or with another client's key: they make the agent send little,
//! and take nothing from others.

use crate::support::{Client, Got, MS, World, data, payloads, reader};
use replenish_agent::{Agent, AgentConfig, Limits};
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    AckNack, BaseRequest, Create, CreateClient, CreationMode, Delete, DeliveryControl, Encode,
    Entity, GetInfo, GroupBinary, Header, MessageWriter, ObjectId, ObjectKind, ParticipantBinary,
    Properties, ReadData, Representation, RequestId, SessionId, Status, StreamId, TopicBinary,
    VENDOR, VERSION,
};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

const ALL: Option<DeliveryControl> = Some(DeliveryControl::UNLIMITED);

/// The forged address.
const VICTIM: u32 = 666;

/// A world with a client that writes topic "t".
fn busy() -> (World, Client) {
    let limits = Limits {
        unauthenticated_per_second: 0,
        ..Limits::DEFAULT
    };
    let mut world = World::new(limits);
    let mut talker = Client::open(&mut world, 1, 1);
    talker.endpoint(&mut world, true, None);
    (world, talker)
}

/// Bytes to the victim for each byte from there.
fn ratio(world: &World) -> f64 {
    let (from, to) = world.bytes[&VICTIM];
    println!(
        "{from} bytes in, {to} bytes out: {:.2} times",
        to as f64 / from as f64
    );
    to as f64 / from as f64
}

/// All that is needed to read topic "t" on stream `on`, without waiting for any answer.
fn subscribe(world: &mut World, client: &mut Client, on: StreamId) {
    let participant = ObjectId::new(1, ObjectKind::Participant);
    let topic = TopicBinary {
        name: "t",
        type_reference: None,
        type_name: Some("T"),
    };
    let entities: [(ObjectKind, Entity<'_>); 4] = [
        (
            ObjectKind::Participant,
            Entity::Participant {
                repr: Representation::Binary(ParticipantBinary::default()),
                domain: 0,
            },
        ),
        (
            ObjectKind::Topic,
            Entity::Topic {
                repr: Representation::Binary(topic),
                participant,
            },
        ),
        (
            ObjectKind::Subscriber,
            Entity::Subscriber {
                repr: Representation::Binary(GroupBinary::default()),
                participant,
            },
        ),
        (ObjectKind::DataReader, reader(1, 100)),
    ];
    for (kind, entity) in entities {
        let base = client.base(ObjectId::new(1, kind));
        let mode = CreationMode::default();
        client.control(world, &Create { base, mode, entity });
    }
    let read = ReadData {
        base: client.base(ObjectId::new(1, ObjectKind::DataReader)),
        stream: on,
        filter: None,
        control: ALL,
    };
    client.control(world, &read);
}

/// b209253 checked no address: 315 bytes with a forged source made it send 701 kB there, and 4.9 kB
/// made it send 14 MB.
#[test]
fn a_forged_subscription_makes_the_agent_send_at_most_three_times_its_bytes() {
    for on in [StreamId::BEST_EFFORT, StreamId::RELIABLE] {
        let (mut world, mut talker) = busy();
        let mut forged = Client::new(VICTIM, 66);
        forged.acknowledging = false;
        forged.login(&mut world);
        subscribe(&mut world, &mut forged, on);
        for i in 0..2000_u32 {
            talker.write(&mut world, 1, &[i as u8; 400]);
            world.pass(MS);
            if i % 100 == 99 {
                // It goes on: another log-in, and everything again.
                let mut again = Client::new(VICTIM, 66 + (i / 100) as u8 % 4);
                again.acknowledging = false;
                again.login(&mut world);
                subscribe(&mut world, &mut again, on);
            }
        }
        assert!(ratio(&world) <= 3.0);
    }
}

/// The same for requests that are answered at once, many in one datagram.
#[test]
fn forged_questions_make_the_agent_send_at_most_three_times_their_bytes() {
    for in_session in [false, true] {
        let (mut world, _) = busy();
        let mut forged = Client::new(VICTIM, 66);
        forged.acknowledging = false;
        if in_session {
            forged.login(&mut world);
        }
        for _ in 0..100 {
            let session = if in_session {
                forged.session
            } else {
                forged.session.before_login()
            };
            let header = Header::new(session, StreamId::NONE, SeqNum(0), forged.key);
            let mut buf = [0; 1400];
            let mut message = MessageWriter::new(&mut buf, &header).unwrap();
            for _ in 0..100 {
                let base = BaseRequest {
                    request: RequestId(10),
                    object: ObjectId::AGENT,
                };
                let mask = 0;
                if message.push_padded(&GetInfo { base, mask }).is_err() {
                    break;
                }
            }
            world.deliver(VICTIM, message.finish());
            world.pass(MS);
        }
        assert!(ratio(&world) <= 3.0);
        assert!(
            ratio(&world) > 1.0,
            "it answers as far as it may: a ping is one"
        );
    }
}

/// A client that acknowledges gets everything, whatever it reads on; before, what it is sent waits.
#[test]
fn a_client_without_reliable_requests_is_asked_and_then_served() {
    let (mut world, mut talker) = busy();
    let mut client = Client::new(2, 2);
    client.login(&mut world);
    client.acknowledging = false;
    subscribe(&mut world, &mut client, StreamId::BEST_EFFORT);
    talker.write(&mut world, 1, b"first");
    world.pass(100 * MS);
    let got = client.got(&mut world);
    assert!(payloads(&got).is_empty(), "{got:?}");
    assert!(got.iter().any(|got| matches!(got, Got::Heartbeat(..))));
    assert!(!world.agent.snapshot(world.at()).clients[1].echoed);

    client.acknowledging = true;
    world.pass(100 * MS);
    assert_eq!(payloads(&client.got(&mut world)), [b"first"]);
    assert!(world.agent.snapshot(world.at()).clients[1].echoed);
    talker.write(&mut world, 1, b"later");
    assert_eq!(payloads(&client.got(&mut world)), [b"later"]);
}

/// On b209253 a log-in with a client's key took its session, from wherever it came: at 24 bytes a
/// second 28 % of the reliable samples were missing.
#[test]
fn a_key_is_taken_from_no_client_that_answers() {
    let (mut world, mut talker) = busy();
    let mut listener = Client::open(&mut world, 2, 2);
    listener.endpoint(&mut world, false, Some(10));
    listener.read(&mut world, 1, StreamId::RELIABLE, ALL);
    let mut arrived = 0;
    for i in 0..1000_u32 {
        for (victim, peer) in [(1, VICTIM), (2, VICTIM + i)] {
            let mut thief = Client::new(peer, victim);
            let answer = thief.login(&mut world);
            assert!(matches!(&*answer, [] | [Got::Agent(Status::DENIED)]));
        }
        world.pass(10 * MS);
        talker.got(&mut world);
        talker.write(&mut world, 1, &i.to_le_bytes());
        arrived += payloads(&listener.got(&mut world)).len();
    }
    let stats = world.agent.stats();
    assert_eq!((arrived, stats.takeovers, stats.clients), (1000, 0, 2));
    println!("{} takeovers refused", stats.takeovers_refused);
    assert!(stats.takeovers_refused > 100);
}

/// A client that only lost datagrams keeps its session: one answer of three is enough.
#[test]
fn one_answer_in_time_keeps_a_session() {
    let (mut world, mut talker) = busy();
    let mut thief = Client::new(VICTIM, 1);
    assert_eq!(thief.login(&mut world), []);
    for lost in 0..2 {
        let asked = world.take(1);
        assert_eq!(asked.len(), 1, "HEARTBEAT {lost}");
        world.pass(250 * MS);
    }
    talker.got(&mut world); // the third one arrives, and is answered
    world.pass(500 * MS);
    assert_eq!(thief.login(&mut world), [Got::Agent(Status::DENIED)]);
    // A restart at another address: the old one has gone, and the next log-in has its session.
    assert_eq!(thief.login(&mut world), []);
    world.pass(749 * MS);
    assert_eq!(thief.login(&mut world), []);
    world.pass(MS);
    assert_eq!(thief.login(&mut world), [Got::Agent(Status::OK)]);
    let stats = world.agent.stats();
    assert_eq!((stats.takeovers, stats.takeovers_refused), (1, 1));
}

/// A DELETE of 12 bytes ended a session, with the key in its header or without. Only one from the
/// session's own address does.
#[test]
fn a_log_out_from_another_address_ends_nothing() {
    let (mut world, mut talker) = busy();
    talker.reader(&mut world, 1, 4);
    talker.read(&mut world, 1, StreamId::RELIABLE, ALL);
    let mut forged = Client::new(VICTIM, 1);
    let base = forged.base(ObjectId::CLIENT);
    for stream in [StreamId::NONE, StreamId::BEST_EFFORT, StreamId::RELIABLE] {
        for session in [forged.session, replenish_xrce::wire::SessionId(0x01)] {
            let header = Header::new(session, stream, SeqNum(0), forged.key);
            let mut buf = [0; 64];
            let mut message = MessageWriter::new(&mut buf, &header).unwrap();
            message.push(&Delete { base }).unwrap();
            world.deliver(VICTIM, message.finish());
        }
    }
    assert_eq!(world.take(VICTIM), [] as [Vec<u8>; 0]);
    assert_eq!(talker.write(&mut world, 1, b"here"), [data(1, b"here")]);
}

/// A stranger who knows a reader's key and session, and tries all sequence numbers, confirms
/// nothing in the reader's name: the sample is confirmed when the reader itself has acknowledged
/// it.
#[test]
fn a_right_acknowledgement_from_another_address_confirms_nothing() {
    let (mut world, mut talker) = busy();
    let mut listener = Client::open(&mut world, 2, 2);
    listener.endpoint(&mut world, false, Some(10));
    listener.read(&mut world, 1, StreamId::RELIABLE, ALL);
    listener.acknowledging = false;
    let before = talker.acknowledged(&mut world);
    talker.write(&mut world, 1, b"safe");
    for number in 0..=u16::MAX {
        let ack = AckNack {
            first_unacked: SeqNum(number),
            missing: 0,
            stream: StreamId::RELIABLE,
        };
        for session in [listener.session, SessionId(0x01)] {
            let header = Header::new(session, StreamId::NONE, SeqNum(0), listener.key);
            let mut buf = [0; 64];
            let mut message = MessageWriter::new(&mut buf, &header).unwrap();
            message.push(&ack).unwrap();
            world.deliver(VICTIM, message.finish());
        }
    }
    assert_eq!(world.take(VICTIM), [] as [Vec<u8>; 0]);
    assert_eq!(talker.acknowledged(&mut world), None, "not by a stranger");
    assert_eq!(world.agent.stats().no_session, 2 << 16);
    assert_eq!(listener.got(&mut world), [data(1, b"safe")]);
    listener.acknowledge(&mut world);
    let after = talker.acknowledged(&mut world);
    assert_eq!(after, before.map(|seq| seq + 1), "by the reader");
}

/// The same on sockets: it is counted, and logged with the address that tried it.
#[test]
fn a_refused_takeover_is_logged_with_its_address() {
    let config = AgentConfig {
        addr: ([127, 0, 0, 1], 0).into(),
        ..AgentConfig::default()
    };
    let agent = Agent::bind(&config).unwrap().spawn().unwrap();
    let socket = || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(agent.local_addr()).unwrap();
        let timeout = Some(Duration::from_secs(60));
        socket.set_read_timeout(timeout).unwrap();
        socket
    };
    let key = replenish_xrce::wire::ClientKey([7; 4]);
    let session = replenish_xrce::wire::SessionId(0x81);
    let send = |socket: &UdpSocket, session, stream, body: &dyn Fn(&mut MessageWriter<'_>)| {
        let header = Header::new(session, stream, SeqNum(0), key);
        let mut buf = [0; 200];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        body(&mut message);
        socket.send(message.finish()).unwrap();
    };
    let login = |socket: &UdpSocket| {
        let create = CreateClient {
            version: VERSION,
            vendor: VENDOR,
            key,
            session,
            properties: Properties::None,
            mtu: 512,
        };
        send(socket, session.before_login(), StreamId::NONE, &|message| {
            encode(message, &create);
        });
    };
    let (owner, thief) = (socket(), socket());
    login(&owner);
    let mut buf = [0; 100];
    assert!(owner.recv(&mut buf).is_ok(), "STATUS_AGENT");
    let soon = Some(Duration::from_millis(20));
    owner.set_read_timeout(soon).unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while agent.stats().takeovers_refused == 0 {
        assert!(Instant::now() < deadline, "never refused");
        login(&thief);
        let get = GetInfo {
            base: BaseRequest {
                request: RequestId(10),
                object: ObjectId::AGENT,
            },
            mask: 0,
        };
        // Anything from the owner's address shows that it lives.
        send(&owner, session, StreamId::NONE, &|message| {
            encode(message, &get);
        });
        while owner.recv(&mut buf).is_ok() {}
    }
    let texts = agent.inspector().rejections().list;
    let texts: Vec<String> = texts.iter().map(ToString::to_string).collect();
    let from = format!(
        "client 07070707 at udp {}: refused a log-in: the client with this key answers at another \
         address",
        thief.local_addr().unwrap()
    );
    assert!(texts.contains(&from), "{texts:?}");
    assert_eq!(agent.stats().takeovers, 0);
}

fn encode(message: &mut MessageWriter<'_>, body: &impl Encode) {
    message.push_padded(body).unwrap();
}

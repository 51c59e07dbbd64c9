//! A client with more objects than the agent keeps answers for.

use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::client::{Buffers, Config, PingPolicy, ReliableBuffers, Session, SessionState};
use replenish_xrce::wire::{
    ClientKey, CreationMode, Entity, Message, ObjectId, ObjectKind, ParticipantBinary,
    Representation, StreamId, TopicBinary,
};

type Client = Session<Vec<u8>, 32, 256>;

const MS: u64 = 1_000_000;
const TOPICS: u16 = 150;

fn client() -> Client {
    let mut config = Config::new(ClientKey([1; 4]));
    config.ping = Some(PingPolicy {
        after: 200 * MS,
        silence_limit: 800 * MS,
    });
    let buffer = |len| vec![0; len];
    let mut session = Session::new(
        config,
        Buffers {
            best_effort: [buffer(512)],
            reliable: [ReliableBuffers {
                output: buffer(32 * 512),
                large_output: buffer(0),
                input: buffer(16 * 512),
                fragments: buffer(512),
            }],
            restore: buffer(512),
            journal: buffer(32 << 10),
        },
    );
    let mode = CreationMode::REUSE_OR_REPLACE;
    let participant = ObjectId::new(1, ObjectKind::Participant);
    let repr = Representation::Binary(ParticipantBinary::default());
    let entity = Entity::Participant { repr, domain: 0 };
    session.create(participant, mode, &entity).unwrap();
    for number in 1..=TOPICS {
        let repr = Representation::Binary(TopicBinary {
            name: &format!("t{number}"),
            type_reference: None,
            type_name: Some("T"),
        });
        let entity = Entity::Topic { repr, participant };
        let topic = ObjectId::new(number, ObjectKind::Topic);
        session.create(topic, mode, &entity).unwrap();
    }
    session
}

/// Lets both talk over a link of 0.1 ms until the session is up; the virtual time then. Of the
/// agent's datagrams those come through that `passes` lets.
fn until_up(
    session: &mut Client,
    agent: &mut AgentCore<usize>,
    mut now: u64,
    passes: impl Fn(&[u8]) -> bool,
) -> u64 {
    let end = now + 60_000 * MS;
    loop {
        session.tick(now, &mut |_| {});
        while let Some(datagram) = session.poll_transmit(now).map(<[u8]>::to_vec) {
            agent.receive(at(now), 0, &datagram);
        }
        let mut sent = Vec::new();
        while agent.pump(at(now), 5, &mut |_, bytes| sent.push(bytes.to_vec())) {}
        for datagram in sent.into_iter().filter(|datagram| passes(datagram)) {
            session.handle(now, &datagram, &mut |_| {});
        }
        if session.state() == SessionState::Up {
            return now;
        }
        now += MS / 10;
        assert!(now < end, "in vain: {:?}", agent.stats());
    }
}

fn at(monotonic: u64) -> Now {
    Now { monotonic, unix: 0 }
}

/// All objects are created at once then, and each creation is answered. Those whose answers were
/// dropped cost the client the five seconds in which it waits for them.
#[test]
fn an_agent_that_starts_again_drops_no_answer() {
    let mut session = client();
    session.connect(0);
    let mut agent = AgentCore::new(Limits::default());
    let mut now = until_up(&mut session, &mut agent, 0, |_| true);
    for round in 0..3 {
        now += MS;
        agent = AgentCore::new(Limits::default());
        session.disconnected(now, &mut |_| {});
        let up = until_up(&mut session, &mut agent, now, |_| true);
        assert_eq!(agent.stats().replies_dropped, 0, "round {round}");
        assert!(up - now < 500 * MS, "{} ms", (up - now) / MS);
        now = up;
    }
}

/// Five seconds in all, and not for each part of the objects.
#[test]
fn an_agent_without_answers_is_waited_for_once() {
    let mut session = client();
    session.connect(0);
    let mut agent = AgentCore::new(Limits::default());
    let is_no_stream = |datagram: &[u8]| {
        let message = Message::parse(datagram).unwrap();
        message.header.stream == StreamId::NONE
    };
    let up = until_up(&mut session, &mut agent, 0, is_no_stream);
    assert!((5_000 * MS..11_000 * MS).contains(&up), "{} ms", up / MS);
}

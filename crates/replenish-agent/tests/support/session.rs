//! A client session with a writer and a reader, as the tests over links and sockets use it.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every test binary uses its own part")]

use replenish_xrce::client::{Buffers, Config, PingPolicy, ReliableBuffers, Session};
use replenish_xrce::wire::{
    ClientKey, CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, EndpointQos,
    Entity, GroupBinary, ObjectId, ObjectKind, ParticipantBinary, QOS_HISTORY_KEEP_LAST,
    QOS_RELIABLE, ReaderQos, Representation, StreamId, TopicBinary, WriterQos,
};

pub(crate) const MS: u64 = 1_000_000;

pub(crate) const WRITER: ObjectId = ObjectId::new(1, ObjectKind::DataWriter);

pub(crate) type Client = Session<Vec<u8>, 32, 32>;

/// A client that takes the agent for lost after `silence_limit` nanoseconds of silence.
pub(crate) fn session(key: u8, silence_limit: u64) -> Client {
    session_with(Config::new(ClientKey([key; 4])), silence_limit)
}

/// One that sends and receives samples of 50 kB.
pub(crate) fn large_session(key: u8, silence_limit: u64) -> Client {
    session_of(Config::new(ClientKey([key; 4])), silence_limit, 51_200)
}

/// The same with other settings.
pub(crate) fn session_with(config: Config, silence_limit: u64) -> Client {
    session_of(config, silence_limit, 0)
}

fn session_of(mut config: Config, silence_limit: u64, large: usize) -> Client {
    config.ping = Some(PingPolicy {
        after: 200 * MS,
        silence_limit,
    });
    let buffer = |len| vec![0; len];
    let buffers = Buffers {
        best_effort: [buffer(512)],
        reliable: [ReliableBuffers {
            output: buffer(32 * 512),
            large_output: buffer(large),
            input: buffer(16 * 512),
            fragments: buffer((32 * 512).max(large)),
        }],
        restore: buffer(512),
        journal: buffer(4096),
    };
    Session::new(config, buffers)
}

/// A participant with a writer of one topic and a reader of another.
pub(crate) fn endpoints(session: &mut Client, writes: &str, reads: &str, stream: StreamId) {
    endpoints_of(session, writes, reads, stream);
}

/// The same, both reliable and keep-all.
pub(crate) fn keep_all(session: &mut Client, writes: &str, reads: &str, stream: StreamId) {
    let all = EndpointQos {
        flags: QOS_RELIABLE,
        ..EndpointQos::default()
    };
    let writer = WriterQos {
        endpoint: all,
        ownership_strength: None,
    };
    endpoints_with(session, (writes, reads), stream, (Some(writer), all));
}

/// The same for a session of another size.
pub(crate) fn endpoints_of<const N: usize>(
    session: &mut Session<Vec<u8>, N, 32>,
    writes: &str,
    reads: &str,
    stream: StreamId,
) {
    let endpoint = EndpointQos {
        flags: QOS_RELIABLE | QOS_HISTORY_KEEP_LAST,
        depth: Some(100),
        ..EndpointQos::default()
    };
    endpoints_with(session, (writes, reads), stream, (None, endpoint));
}

fn endpoints_with<const N: usize>(
    session: &mut Session<Vec<u8>, N, 32>,
    (writes, reads): (&str, &str),
    stream: StreamId,
    (of_writer, endpoint): (Option<WriterQos>, EndpointQos),
) {
    let id = ObjectId::new;
    let participant = id(1, ObjectKind::Participant);
    let mut create = |object, entity| {
        session
            .create(object, CreationMode::REUSE_OR_REPLACE, &entity)
            .unwrap();
    };
    let repr = Representation::Binary(ParticipantBinary::default());
    create(participant, Entity::Participant { repr, domain: 0 });
    for (number, name) in [(1, writes), (2, reads)] {
        let topic = TopicBinary {
            name,
            type_reference: None,
            type_name: Some("T"),
        };
        let repr = Representation::Binary(topic);
        create(
            id(number, ObjectKind::Topic),
            Entity::Topic { repr, participant },
        );
    }
    let repr = Representation::Binary(GroupBinary::default());
    let (publisher, subscriber) = (id(1, ObjectKind::Publisher), id(1, ObjectKind::Subscriber));
    create(publisher, Entity::Publisher { repr, participant });
    create(subscriber, Entity::Subscriber { repr, participant });
    let topic = id(1, ObjectKind::Topic);
    let repr = Representation::Binary(DataWriterBinary {
        topic,
        qos: of_writer,
    });
    create(
        id(1, ObjectKind::DataWriter),
        Entity::DataWriter { repr, publisher },
    );
    let qos = Some(ReaderQos {
        endpoint,
        ..ReaderQos::default()
    });
    let topic = id(2, ObjectKind::Topic);
    let repr = Representation::Binary(DataReaderBinary { topic, qos });
    let reader = id(2, ObjectKind::DataReader);
    create(reader, Entity::DataReader { repr, subscriber });
    session
        .read(reader, stream, DeliveryControl::UNLIMITED)
        .unwrap();
}

//! Our client on a UDP socket.

use replenish_xrce::client::{
    Buffers, Config, Event, PingPolicy, ReliableBuffers, Session, SessionState, WriteError,
};
use replenish_xrce::udp::UdpTransport;
use replenish_xrce::wire::{
    ClientKey, CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, Entity,
    GroupBinary, ObjectId, ObjectKind, ParticipantBinary, Representation, StreamId, TopicBinary,
};
use std::net::SocketAddr;
use std::time::Instant;

#[derive(Debug)]
pub(crate) struct Ours {
    session: Session<Vec<u8>, 16, 16>,
    socket: UdpTransport,
    started: Instant,
    pub(crate) got: Vec<Vec<u8>>,
}

impl Ours {
    /// A client that writes one topic and reads another.
    pub(crate) fn connect(
        agent: SocketAddr,
        key: u8,
        writes: &str,
        reads: &str,
        reliable: bool,
    ) -> Self {
        let config = Config {
            // The peer's agent answers no pings in a session.
            ping: None::<PingPolicy>,
            ..Config::new(ClientKey([key; 4]))
        };
        let buffers = Buffers {
            best_effort: [vec![0; 512]],
            reliable: [ReliableBuffers {
                output: vec![0; 16 * 512],
                large_output: Vec::new(),
                input: vec![0; 16 * 512],
                fragments: vec![0; 4096],
            }],
            journal: vec![0; 4096],
            restore: Vec::new(),
        };
        let mut ours = Self {
            session: Session::new(config, buffers),
            socket: UdpTransport::connect(agent).unwrap(),
            started: Instant::now(),
            got: Vec::new(),
        };
        ours.endpoints(writes, reads, reliable);
        ours.session.connect(ours.now());
        ours
    }

    fn endpoints(&mut self, writes: &str, reads: &str, reliable: bool) {
        let id = ObjectId::new;
        let participant = id(1, ObjectKind::Participant);
        let (publisher, subscriber) = (id(1, ObjectKind::Publisher), id(1, ObjectKind::Subscriber));
        let topic = |name| {
            let topic = TopicBinary {
                name,
                type_reference: None,
                type_name: Some("T"),
            };
            let repr = Representation::Binary(topic);
            Entity::Topic { repr, participant }
        };
        let writer = DataWriterBinary {
            topic: id(1, ObjectKind::Topic),
            qos: None,
        };
        let reader = DataReaderBinary {
            topic: id(2, ObjectKind::Topic),
            qos: None,
        };
        let group = || Representation::Binary(GroupBinary::default());
        let repr = Representation::Binary(ParticipantBinary::default());
        for (number, entity) in [
            (1, Entity::Participant { repr, domain: 0 }),
            (1, topic(writes)),
            (2, topic(reads)),
            (
                1,
                Entity::Publisher {
                    repr: group(),
                    participant,
                },
            ),
            (
                1,
                Entity::Subscriber {
                    repr: group(),
                    participant,
                },
            ),
            (
                1,
                Entity::DataWriter {
                    repr: Representation::Binary(writer),
                    publisher,
                },
            ),
            (
                1,
                Entity::DataReader {
                    repr: Representation::Binary(reader),
                    subscriber,
                },
            ),
        ] {
            let object = id(number, entity.kind());
            let mode = CreationMode::REUSE_OR_REPLACE;
            self.session.create(object, mode, &entity).unwrap();
        }
        let reader = id(1, ObjectKind::DataReader);
        let control = DeliveryControl::UNLIMITED;
        self.session
            .read(reader, stream(reliable), control)
            .unwrap();
    }

    fn now(&self) -> u64 {
        self.started.elapsed().as_nanos() as u64
    }

    pub(crate) fn is_up(&self) -> bool {
        self.session.state() == SessionState::Up && self.session.is_delivered()
    }

    pub(crate) fn write(&mut self, payload: &[u8], reliable: bool) {
        let writer = ObjectId::new(1, ObjectKind::DataWriter);
        loop {
            match self.session.write(writer, stream(reliable), payload) {
                Ok(()) => break,
                Err(WriteError::WouldBlock) => self.turn(),
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// Sends what there is and takes in what has come.
    pub(crate) fn turn(&mut self) {
        let now = self.now();
        let got = &mut self.got;
        let mut keep = |event: Event<'_>| match event {
            Event::Data { payload, .. } => got.push(payload.to_vec()),
            Event::Status { status, .. } => assert!(status.is_ok(), "{status:?}"),
            Event::Refused(status) => panic!("{status:?}"),
            _ => {}
        };
        let mut buf = [0; 2048];
        while let Some(len) = self.socket.recv(&mut buf).unwrap() {
            self.session.handle(now, &buf[..len], &mut keep);
        }
        self.session.tick(now, &mut keep);
        while let Some(datagram) = self.session.poll_transmit(now) {
            self.socket.send(datagram).unwrap();
        }
    }
}

fn stream(reliable: bool) -> StreamId {
    if reliable {
        StreamId::RELIABLE
    } else {
        StreamId::BEST_EFFORT
    }
}

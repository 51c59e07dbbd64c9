//! One XRCE client on a UDP socket: a session, its entities, and what it has received.

use crate::load::{MS, Nanos, SEC};
use replenish_cli::outcome::Failure;
use replenish_os::clock;
use replenish_xrce::client::{
    Buffers, Config, Event, PingPolicy, ReliableBuffers, Session, SessionState, WriteError,
};
use replenish_xrce::stream::AckPolicy;
use replenish_xrce::udp::UdpTransport;
use replenish_xrce::wire::{
    ClientKey, CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, EndpointQos,
    Entity, GroupBinary, ObjectId, ObjectKind, ParticipantBinary, QOS_HISTORY_KEEP_LAST,
    QOS_RELIABLE, ReaderQos, Representation, Status, StreamId, TopicBinary, WriterQos,
};
use std::net::SocketAddr;

/// Messages of a reliable stream each way that can wait for an acknowledgement.
const RING: usize = 64;

/// Objects of a client.
const OBJECTS: usize = 256;

/// Bytes of the longest message.
const MTU: usize = 1024;

/// A client; one thread owns it.
#[derive(Debug)]
pub(crate) struct Client {
    session: Session<Vec<u8>, RING, OBJECTS>,
    transport: UdpTransport,
    buf: Vec<u8>,
    notes: Notes,
}

/// Events of a session other than samples.
#[derive(Debug, Default)]
struct Notes {
    /// The session has lost its agent.
    lost: bool,
    /// An object that the agent has refused.
    refused: Option<(ObjectId, Status)>,
}

/// A reader or a writer of a topic.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Endpoint<'a> {
    /// Tells it from the client's other endpoints: 1 to 60.
    pub number: u16,
    /// The topic.
    pub topic: &'a str,
    /// Samples that the agent keeps for a reader.
    pub depth: u16,
}

impl Client {
    /// A client of the agent at `agent`; begins to log in.
    pub(crate) fn connect(agent: SocketAddr, key: u32, acks: AckPolicy) -> Result<Self, Failure> {
        let failed = |e| Failure::refused(format!("a socket for {agent}: {e}"));
        let transport = UdpTransport::connect(agent).map_err(failed)?;
        let config = Config {
            acks,
            mtu: u16::try_from(MTU).unwrap_or(512),
            // A machine that stands still for a moment is not a lost agent.
            ping: Some(PingPolicy {
                after: SEC,
                silence_limit: 10 * SEC,
            }),
            ..Config::new(ClientKey(key.to_be_bytes()))
        };
        let buffer = |len| vec![0; len];
        let buffers = Buffers {
            best_effort: [buffer(MTU)],
            reliable: [ReliableBuffers {
                output: buffer(RING * MTU),
                large_output: buffer(0),
                input: buffer(16 * MTU),
                fragments: buffer(4 * MTU),
            }],
            restore: buffer(MTU),
            journal: buffer(16 * 1024),
        };
        let mut session = Session::new(config, buffers);
        session.connect(clock::monotonic());
        Ok(Self {
            session,
            transport,
            buf: vec![0; 64 * 1024],
            notes: Notes::default(),
        })
    }

    /// Asks for a participant, a publisher and a subscriber, and for these endpoints.
    pub(crate) fn equip(
        &mut self,
        writers: &[Endpoint<'_>],
        readers: &[Endpoint<'_>],
        stream: StreamId,
    ) -> Result<(), Failure> {
        let participant = id(1, ObjectKind::Participant);
        let (publisher, subscriber) = (id(1, ObjectKind::Publisher), id(1, ObjectKind::Subscriber));
        let repr = Representation::Binary(ParticipantBinary::default());
        self.create(participant, &Entity::Participant { repr, domain: 0 })?;
        let repr = Representation::Binary(GroupBinary::default());
        self.create(publisher, &Entity::Publisher { repr, participant })?;
        self.create(subscriber, &Entity::Subscriber { repr, participant })?;
        let reliable = if stream.is_reliable() {
            QOS_RELIABLE
        } else {
            0
        };
        for (kind, endpoint) in writers
            .iter()
            .map(|w| (ObjectKind::DataWriter, w))
            .chain(readers.iter().map(|r| (ObjectKind::DataReader, r)))
        {
            let object = id(endpoint.number, kind);
            let number = match kind {
                ObjectKind::DataWriter => endpoint.number,
                _ => endpoint.number + 64,
            };
            let topic = id(number, ObjectKind::Topic);
            let repr = Representation::Binary(TopicBinary {
                name: endpoint.topic,
                type_reference: None,
                type_name: Some("replenish::bench"),
            });
            self.create(topic, &Entity::Topic { repr, participant })?;
            let qos = EndpointQos {
                flags: QOS_HISTORY_KEEP_LAST | reliable,
                depth: Some(endpoint.depth),
                ..EndpointQos::default()
            };
            if kind == ObjectKind::DataWriter {
                let qos = Some(WriterQos {
                    endpoint: qos,
                    ..WriterQos::default()
                });
                let repr = Representation::Binary(DataWriterBinary { topic, qos });
                self.create(object, &Entity::DataWriter { repr, publisher })?;
            } else {
                let qos = Some(ReaderQos {
                    endpoint: qos,
                    ..ReaderQos::default()
                });
                let repr = Representation::Binary(DataReaderBinary { topic, qos });
                self.create(object, &Entity::DataReader { repr, subscriber })?;
                self.session
                    .read(object, stream, DeliveryControl::UNLIMITED)
                    .map_err(Failure::refused)?;
            }
        }
        Ok(())
    }

    fn create(&mut self, object: ObjectId, entity: &Entity<'_>) -> Result<(), Failure> {
        let mode = CreationMode::REUSE_OR_REPLACE;
        let created = self.session.create(object, mode, entity);
        created.map_err(Failure::refused)
    }

    /// Waits until the session is up; an error if it is not within `limit` or something was
    /// refused.
    pub(crate) fn await_up(&mut self, limit: Nanos) -> Result<(), Failure> {
        let until = clock::monotonic().saturating_add(limit);
        while self.session.state() != SessionState::Up {
            let now = clock::monotonic();
            if now >= until {
                let agent = self.transport.agent();
                return Err(Failure::refused(format!("no session with {agent}")));
            }
            self.serve(now, &mut |_, _| {})?;
            let wait = self.deadline().unwrap_or(until).min(until);
            self.wait(wait.min(now + 50 * MS))?;
        }
        match self.notes.refused {
            Some((object, status)) => {
                let why = format!("the agent refuses {object:?}: {status}");
                Err(Failure::refused(why))
            }
            None => Ok(()),
        }
    }

    /// Writes a sample; false if the stream has no room now.
    pub(crate) fn write(
        &mut self,
        number: u16,
        stream: StreamId,
        payload: &[u8],
    ) -> Result<bool, Failure> {
        let writer = id(number, ObjectKind::DataWriter);
        match self.session.write(writer, stream, payload) {
            Ok(()) => Ok(true),
            Err(WriteError::WouldBlock) => Ok(false),
            Err(error) => Err(Failure::refused(error)),
        }
    }

    /// Takes what has come, `data` gets the number of the reader and the payload of each sample;
    /// sends what is due.
    pub(crate) fn serve(
        &mut self,
        now: Nanos,
        data: &mut impl FnMut(u16, &[u8]),
    ) -> Result<(), Failure> {
        while self.receive(now, data)? {}
        self.send(now, data)
    }

    /// Takes one datagram if there is one.
    pub(crate) fn receive(
        &mut self,
        now: Nanos,
        data: &mut impl FnMut(u16, &[u8]),
    ) -> Result<bool, Failure> {
        let Self {
            session,
            transport,
            buf,
            notes,
        } = self;
        let Some(len) = transport.recv(buf).map_err(Failure::refused)? else {
            return Ok(false);
        };
        let datagram = buf.get(..len).unwrap_or_default();
        session.handle(now, datagram, &mut |event| notes.hear(event, data));
        Ok(true)
    }

    /// Sends what is due at `now`.
    pub(crate) fn send(
        &mut self,
        now: Nanos,
        data: &mut impl FnMut(u16, &[u8]),
    ) -> Result<(), Failure> {
        let Self {
            session,
            transport,
            notes,
            ..
        } = self;
        session.tick(now, &mut |event| notes.hear(event, data));
        while let Some(datagram) = session.poll_transmit(now) {
            transport.send(datagram).map_err(Failure::refused)?;
        }
        Ok(())
    }

    /// Waits until a datagram is there or `until`.
    pub(crate) fn wait(&self, until: Nanos) -> Result<(), Failure> {
        let mut fds = [replenish_os::PollFd::readable(&self.transport)];
        let waited = replenish_os::poll(&mut fds, Some(until));
        waited.map(drop).map_err(Failure::refused)
    }

    /// Time at which [`send`](Self::send) is due although nothing has come.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        self.session.next_deadline()
    }

    /// The transport of the session, for a thread that waits for datagrams.
    pub(crate) fn transport(&self) -> &UdpTransport {
        &self.transport
    }

    /// Whether all that was written has been acknowledged.
    pub(crate) fn is_delivered(&self) -> bool {
        self.session.is_delivered()
    }

    /// Whether it has ever lost its agent.
    pub(crate) fn has_lost_agent(&self) -> bool {
        self.notes.lost
    }

    /// Messages that it has sent again.
    pub(crate) fn resent(&self) -> u64 {
        self.session.output_stats().resent
    }
}

impl Notes {
    fn hear(&mut self, event: Event<'_>, data: &mut impl FnMut(u16, &[u8])) {
        match event {
            Event::Data {
                reader, payload, ..
            } => data(reader.number(), payload),
            Event::Down => self.lost = true,
            Event::Status { object, status, .. } if !status.is_ok() => {
                self.refused = Some((object, status));
            }
            _ => {}
        }
    }
}

const fn id(number: u16, kind: ObjectKind) -> ObjectId {
    ObjectId::new(number, kind)
}

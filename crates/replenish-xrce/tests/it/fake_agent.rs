//! A scripted agent without I/O: accepts sessions and objects, answers pings and time requests,
//! keeps what was written, and hands out samples on command.

#![allow(dead_code, reason = "every test binary uses its own part")]

use std::collections::BTreeMap;

use replenish_xrce::stream::{InputReliable, OutputReliable, Reliability, StreamHeader, Tail};
use replenish_xrce::wire::{
    AgentInfo, BaseRequest, Body, ClientKey, Data, Encode, Info, Message, MessageWriter, ObjectId,
    SessionId, Status, StatusAgent, StatusReply, StreamId, Submessage, TimestampReply, VENDOR,
    VERSION, WireTime,
};
use replenish_xrce::{Nanos, SeqNum};

const MTU: usize = 512;

/// The agent's side of the one session it has.
pub(crate) struct FakeAgent {
    session: Option<(SessionId, ClientKey)>,
    inputs: BTreeMap<u8, InputReliable<Vec<u8>, Vec<u8>, 16>>,
    output: OutputReliable<Vec<u8>, 16>,
    out: Vec<Vec<u8>>,
    /// The answer to log-ins.
    pub(crate) login_status: Status,
    /// The answer to creations.
    pub(crate) create_status: Status,
    /// Sessions given so far.
    pub(crate) sessions: Vec<SessionId>,
    /// Objects and reads of the current session, in order.
    pub(crate) created: Vec<ObjectId>,
    pub(crate) reads: Vec<(BaseRequest, StreamId)>,
    /// Acknowledges requests, but does not answer them.
    pub(crate) mute: bool,
    /// The properties of the latest log-in.
    pub(crate) properties: Vec<(String, String)>,
    /// Samples written, of all sessions.
    pub(crate) written: Vec<(ObjectId, Vec<u8>)>,
    best_effort: SeqNum,
}

impl FakeAgent {
    pub(crate) fn new() -> Self {
        let header = StreamHeader {
            session: SessionId(0x81),
            stream: StreamId::RELIABLE,
            key: ClientKey([0; 4]),
        };
        let (ring, config) = (vec![0; 16 * MTU], Reliability::default());
        FakeAgent {
            session: None,
            inputs: BTreeMap::new(),
            output: OutputReliable::new(ring, MTU, header, Tail::Exact, config),
            out: Vec::new(),
            login_status: Status::OK,
            create_status: Status::OK,
            sessions: Vec::new(),
            created: Vec::new(),
            reads: Vec::new(),
            mute: false,
            properties: Vec::new(),
            written: Vec::new(),
            best_effort: SeqNum(0),
        }
    }

    /// Forgets its session, like an agent that was started again.
    pub(crate) fn restart(&mut self) {
        self.session = None;
        self.out.clear();
    }

    /// A datagram of the client has arrived; returns what it sends.
    pub(crate) fn handle(&mut self, now: Nanos, datagram: &[u8]) -> Vec<Vec<u8>> {
        let message = Message::parse(datagram).expect("a message");
        let header = message.header;
        if let Some(Ok(first)) = message.submessages().next()
            && let Ok(Body::CreateClient(create)) = first.body()
        {
            assert!(header.session.is_none(), "a log-in outside of sessions");
            self.properties.clear();
            create.properties.for_each(|name, value| {
                self.properties.push((name.into(), value.into()));
            });
            self.login(create.session, create.key);
            return self.drain(now);
        }
        if self
            .session
            .is_none_or(|(session, _)| session != header.session)
        {
            return Vec::new();
        }
        if header.stream.is_reliable() {
            let mut submessages: Vec<(Vec<u8>, _, _)> = Vec::new();
            let input = self.input(header.stream);
            input.receive(header.seq, message.body, |s| {
                submessages.push((s.payload.to_vec(), s.id, s.flags));
            });
            for (payload, id, flags) in submessages {
                self.submessage(
                    now,
                    &Submessage {
                        id,
                        flags,
                        payload: &payload,
                    },
                );
            }
        } else {
            for submessage in message.submessages() {
                self.submessage(now, &submessage.expect("a submessage"));
            }
        }
        self.drain(now)
    }

    /// Time has passed; returns what it sends.
    pub(crate) fn tick(&mut self, now: Nanos) -> Vec<Vec<u8>> {
        self.drain(now)
    }

    /// Delivers a sample to every read of `reader`.
    pub(crate) fn deliver(&mut self, now: Nanos, reader: ObjectId, payload: &[u8]) -> Vec<Vec<u8>> {
        for (base, stream) in self.reads.clone() {
            if base.object != reader {
                continue;
            }
            let data = Data { base, payload };
            if stream.is_reliable() {
                self.output.push(&data).expect("room");
            } else {
                let seq = self.best_effort;
                self.best_effort = seq.plus(1);
                self.send(stream, seq, &data);
            }
        }
        self.drain(now)
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.output.is_idle()
    }

    fn input(&mut self, stream: StreamId) -> &mut InputReliable<Vec<u8>, Vec<u8>, 16> {
        self.inputs
            .entry(stream.0)
            .or_insert_with(|| InputReliable::new(stream, vec![0; 16 * MTU], MTU, vec![0; 66_000]))
    }

    fn login(&mut self, session: SessionId, key: ClientKey) {
        self.session = Some((session, key));
        if self.login_status.is_ok() {
            self.sessions.push(session);
            self.created.clear();
            self.reads.clear();
            self.best_effort = SeqNum(0);
            self.inputs.clear();
            self.output.reset(StreamHeader {
                session,
                stream: StreamId::RELIABLE,
                key,
            });
        }
        let status = self.login_status;
        let answer = StatusAgent {
            status,
            implementation: 0,
            version: VERSION,
            vendor: VENDOR,
            properties: Default::default(),
        };
        self.send(StreamId::NONE, SeqNum(0), &answer);
        if !status.is_ok() {
            self.session = None;
        }
    }

    fn submessage(&mut self, now: Nanos, submessage: &Submessage<'_>) {
        match submessage.body().expect("a body") {
            Body::Create(create) => {
                self.created.push(create.base.object);
                if self.mute {
                    return;
                }
                let answer = StatusReply {
                    base: create.base,
                    status: self.create_status,
                    implementation: 0,
                };
                self.output.push(&answer).expect("room");
            }
            Body::Delete(delete) => {
                let answer = StatusReply {
                    base: delete.base,
                    status: Status::OK,
                    implementation: 0,
                };
                if delete.base.object == ObjectId::CLIENT {
                    self.send(StreamId::NONE, SeqNum(0), &answer);
                    self.session = None;
                } else {
                    self.created.retain(|object| *object != delete.base.object);
                    self.output.push(&answer).expect("room");
                }
            }
            Body::ReadData(read) => self.reads.push((read.base, read.stream)),
            Body::WriteData(write) => {
                self.written
                    .push((write.base.object, write.payload.to_vec()));
            }
            Body::GetInfo(get) => {
                let agent = Some(AgentInfo {
                    version: VERSION,
                    vendor: VENDOR,
                });
                let info = Info {
                    base: get.base,
                    status: Status::OK,
                    implementation: 0,
                    agent,
                    availability: Some(1),
                };
                self.send(StreamId::NONE, SeqNum(0), &info);
            }
            Body::Timestamp(request) => {
                let time = WireTime {
                    seconds: 1000,
                    nanoseconds: 0,
                };
                let reply = TimestampReply {
                    transmit: time,
                    receive: time,
                    originate: request.transmit,
                };
                self.send(StreamId::NONE, SeqNum(0), &reply);
            }
            Body::AckNack(ack) => self.output.acknowledge(now, ack.first_unacked, ack.missing),
            Body::Heartbeat(heartbeat) => {
                self.input(heartbeat.stream).heartbeat(heartbeat.last);
            }
            other => panic!("unexpected {other:?}"),
        }
    }

    fn drain(&mut self, now: Nanos) -> Vec<Vec<u8>> {
        let mut inputs: Vec<_> = self.inputs.values_mut().collect();
        let acks: Vec<_> = inputs.iter_mut().filter_map(|i| i.take_ack()).collect();
        for ack in acks {
            self.send(StreamId::NONE, SeqNum(0), &ack);
        }
        if let Some(heartbeat) = self.output.take_heartbeat(now) {
            self.send(StreamId::NONE, SeqNum(0), &heartbeat);
        }
        while let Some(bytes) = self.output.next_datagram(now) {
            self.out.push(bytes.to_vec());
        }
        std::mem::take(&mut self.out)
    }

    fn send(&mut self, stream: StreamId, seq: SeqNum, body: &impl Encode) {
        let Some((session, key)) = self.session else {
            return;
        };
        let mut buf = [0; 2048];
        let header = StreamHeader {
            session,
            stream,
            key,
        }
        .at(seq);
        let mut writer = MessageWriter::new(&mut buf, &header).unwrap();
        writer.push(body).unwrap();
        self.out.push(writer.finish().to_vec());
    }
}

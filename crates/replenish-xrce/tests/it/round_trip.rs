//! Every submessage with every kind of content: what is encoded is decoded to the same, alone, in a
//! message with others, and when it is written in pieces.

use proptest::collection::vec;
use proptest::option::of;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    AckNack, AgentInfo, BaseRequest, Body, ClientKey, Create, CreateClient, CreationMode, Data,
    DataReaderBinary, DataWriterBinary, Delete, DeliveryControl, Encode, EndpointQos, Entity,
    Fragment, GetInfo, GroupBinary, Header, Heartbeat, Info, Message, MessageWriter, ObjectId,
    ParticipantBinary, Properties, ReadData, ReaderQos, Representation, RequestId, Reset,
    ServiceBinary, SessionId, Status, StatusAgent, StatusReply, StreamId, SubmessageId, Timestamp,
    TimestampReply, TopicBinary, WireTime, WriteData, Writer, WriterQos, measure, submessage_len,
};
use std::collections::BTreeSet;

type Pairs = &'static [(&'static str, &'static str)];

/// Bodies borrow; what they borrow from is never freed, which a test can afford.
fn leak<T: ?Sized>(owned: Box<T>) -> &'static T {
    Box::leak(owned)
}

fn text() -> impl Strategy<Value = &'static str> {
    "[^\\x00]{0,40}".prop_map(|text| leak(text.into_boxed_str()))
}

fn bytes(most: usize) -> impl Strategy<Value = &'static [u8]> {
    vec(any::<u8>(), 0..most).prop_map(|bytes| leak(bytes.into_boxed_slice()))
}

fn object() -> impl Strategy<Value = ObjectId> {
    any::<[u8; 2]>().prop_map(ObjectId::from_bytes)
}

fn base() -> impl Strategy<Value = BaseRequest> {
    (any::<u16>(), object()).prop_map(|(request, object)| BaseRequest {
        request: RequestId(request),
        object,
    })
}

fn pairs() -> impl Strategy<Value = Option<Pairs>> {
    of(vec((text(), text()), 0..4).prop_map(|pairs| leak(pairs.into_boxed_slice())))
}

fn properties(pairs: Option<Pairs>) -> Properties<'static> {
    pairs.map_or(Properties::None, Properties::List)
}

fn time() -> impl Strategy<Value = WireTime> {
    (any::<i32>(), any::<u32>()).prop_map(|(seconds, nanoseconds)| WireTime {
        seconds,
        nanoseconds,
    })
}

fn representation<B: std::fmt::Debug + 'static>(
    binary: impl Strategy<Value = B> + 'static,
) -> impl Strategy<Value = Representation<'static, B>> {
    prop_oneof![
        1 => text().prop_map(Representation::Reference),
        1 => text().prop_map(Representation::Xml),
        4 => binary.prop_map(Representation::Binary),
    ]
}

fn qos() -> impl Strategy<Value = EndpointQos<'static>> {
    let numbers = (
        any::<u16>(),
        of(any::<u16>()),
        of(any::<u32>()),
        of(any::<u32>()),
    );
    (numbers, of(bytes(20))).prop_map(|((flags, depth, deadline_ms, lifespan_ms), user_data)| {
        EndpointQos {
            flags,
            depth,
            deadline_ms,
            lifespan_ms,
            user_data,
        }
    })
}

fn participant() -> impl Strategy<Value = ParticipantBinary<'static>> {
    (of(text()), of(text())).prop_map(|(domain_reference, name)| ParticipantBinary {
        domain_reference,
        name,
    })
}

fn topic() -> impl Strategy<Value = TopicBinary<'static>> {
    (text(), of(text()), of(text())).prop_map(|(name, type_reference, type_name)| TopicBinary {
        name,
        type_reference,
        type_name,
    })
}

fn group() -> impl Strategy<Value = GroupBinary<'static>> {
    of(text()).prop_map(|name| GroupBinary { name })
}

fn service() -> impl Strategy<Value = ServiceBinary<'static>> {
    (text(), text(), text(), of(text()), of(text())).prop_map(
        |(service, request_type, reply_type, request_topic, reply_topic)| ServiceBinary {
            service,
            request_type,
            reply_type,
            request_topic,
            reply_topic,
        },
    )
}

fn writer() -> impl Strategy<Value = DataWriterBinary<'static>> {
    let qos = (qos(), of(any::<u32>())).prop_map(|(endpoint, ownership_strength)| WriterQos {
        endpoint,
        ownership_strength,
    });
    (object(), of(qos)).prop_map(|(topic, qos)| DataWriterBinary { topic, qos })
}

fn reader() -> impl Strategy<Value = DataReaderBinary<'static>> {
    let qos = (qos(), of(any::<u32>()), of(text())).prop_map(
        |(endpoint, time_filter_ms, content_filter)| ReaderQos {
            endpoint,
            time_filter_ms,
            content_filter,
        },
    );
    (object(), of(qos)).prop_map(|(topic, qos)| DataReaderBinary { topic, qos })
}

fn entity() -> impl Strategy<Value = Entity<'static>> {
    prop_oneof![
        (representation(participant()), any::<i16>())
            .prop_map(|(repr, domain)| Entity::Participant { repr, domain }),
        (representation(topic()), object())
            .prop_map(|(repr, participant)| Entity::Topic { repr, participant }),
        (representation(group()), object())
            .prop_map(|(repr, participant)| Entity::Publisher { repr, participant }),
        (representation(group()), object())
            .prop_map(|(repr, participant)| Entity::Subscriber { repr, participant }),
        (representation(writer()), object())
            .prop_map(|(repr, publisher)| Entity::DataWriter { repr, publisher }),
        (representation(reader()), object())
            .prop_map(|(repr, subscriber)| Entity::DataReader { repr, subscriber }),
        (representation(service()), object())
            .prop_map(|(repr, participant)| Entity::Requester { repr, participant }),
        (representation(service()), object())
            .prop_map(|(repr, participant)| Entity::Replier { repr, participant }),
    ]
}

fn session_bodies() -> impl Strategy<Value = Body<'static>> {
    let login = (
        any::<[u8; 4]>(),
        any::<[u8; 4]>(),
        any::<u8>(),
        pairs(),
        any::<u16>(),
    );
    let answer = (any::<[u8; 4]>(), any::<u8>(), any::<u8>(), pairs());
    let agent = of(any::<[u8; 4]>());
    prop_oneof![
        login.prop_map(
            |([a, b, c, d], key, session, pairs, mtu)| Body::CreateClient(CreateClient {
                version: [a, b],
                vendor: [c, d],
                key: ClientKey(key),
                session: SessionId(session),
                properties: properties(pairs),
                mtu,
            })
        ),
        answer.prop_map(
            |([a, b, c, d], status, implementation, pairs)| Body::StatusAgent(StatusAgent {
                status: Status(status),
                implementation,
                version: [a, b],
                vendor: [c, d],
                properties: properties(pairs),
            })
        ),
        (base(), any::<u8>(), any::<u8>()).prop_map(|(base, status, implementation)| {
            Body::Status(StatusReply {
                base,
                status: Status(status),
                implementation,
            })
        }),
        (base(), any::<u32>()).prop_map(|(base, mask)| Body::GetInfo(GetInfo { base, mask })),
        (base(), any::<u8>(), agent, of(any::<i16>())).prop_map(
            |(base, status, agent, availability)| Body::Info(Info {
                base,
                status: Status(status),
                implementation: 0,
                agent: agent.map(|[a, b, c, d]| AgentInfo {
                    version: [a, b],
                    vendor: [c, d],
                }),
                availability,
            })
        ),
        time().prop_map(|transmit| Body::Timestamp(Timestamp { transmit })),
        (time(), time(), time()).prop_map(|(transmit, receive, originate)| {
            Body::TimestampReply(TimestampReply {
                transmit,
                receive,
                originate,
            })
        }),
    ]
}

fn stream_bodies() -> impl Strategy<Value = Body<'static>> {
    let mode = any::<[bool; 2]>().prop_map(|[reuse, replace]| CreationMode { reuse, replace });
    let control = any::<[u16; 4]>().prop_map(|[samples, elapsed, bytes, pace]| DeliveryControl {
        max_samples: samples,
        max_elapsed_s: elapsed,
        max_bytes_per_second: bytes,
        min_pace_ms: pace,
    });
    let numbers = || (any::<u16>(), any::<u16>(), any::<u8>());
    prop_oneof![
        8 => (base(), mode, entity())
            .prop_map(|(base, mode, entity)| Body::Create(Create { base, mode, entity })),
        1 => base().prop_map(|base| Body::Delete(Delete { base })),
        1 => (base(), bytes(300))
            .prop_map(|(base, payload)| Body::WriteData(WriteData { base, payload })),
        1 => (base(), bytes(300)).prop_map(|(base, payload)| Body::Data(Data { base, payload })),
        2 => (base(), any::<u8>(), of(text()), of(control)).prop_map(
            |(base, stream, filter, control)| Body::ReadData(ReadData {
                base,
                stream: StreamId(stream),
                filter,
                control,
            })
        ),
        1 => numbers().prop_map(|(first, missing, stream)| Body::AckNack(AckNack {
            first_unacked: SeqNum(first),
            missing,
            stream: StreamId(stream),
        })),
        1 => numbers().prop_map(|(first, last, stream)| Body::Heartbeat(Heartbeat {
            first: SeqNum(first),
            last: SeqNum(last),
            stream: StreamId(stream),
        })),
        1 => Just(Body::Reset(Reset)),
        1 => (any::<bool>(), bytes(300))
            .prop_map(|(last, piece)| Body::Fragment(Fragment { last, piece })),
    ]
}

fn any_body() -> impl Strategy<Value = Body<'static>> {
    prop_oneof![session_bodies(), stream_bodies()]
}

fn encoded(body: &Body<'_>) -> Vec<u8> {
    let mut buf = vec![0; measure(body).unwrap()];
    let mut w = Writer::new(&mut buf);
    body.encode(&mut w).unwrap();
    assert_eq!(w.len(), buf.len(), "measured as it is");
    buf
}

/// Properties as pairs, and the body without them: received ones are kept in another form.
fn comparable(body: Body<'_>) -> (Body<'_>, Option<Vec<(String, String)>>) {
    let listed = |properties: Properties<'_>| {
        let mut all = Vec::new();
        properties.for_each(|name, value| all.push((name.into(), value.into())));
        (properties != Properties::None).then_some(all)
    };
    let properties = Properties::None;
    match body {
        Body::CreateClient(create) => {
            let all = listed(create.properties);
            (
                Body::CreateClient(CreateClient {
                    properties,
                    ..create
                }),
                all,
            )
        }
        Body::StatusAgent(status) => {
            let all = listed(status.properties);
            (
                Body::StatusAgent(StatusAgent {
                    properties,
                    ..status
                }),
                all,
            )
        }
        other => (other, None),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4_000, ..ProptestConfig::default() })]

    #[test]
    fn every_body(body in any_body(), window in (0_usize..400, 0_usize..400)) {
        let buf = encoded(&body);
        let decoded = Body::decode(body.id(), body.flags() | 1, &buf).unwrap();
        prop_assert_eq!(comparable(decoded), comparable(body));
        prop_assert_eq!(encoded(&decoded), &buf[..]);

        // A window shows the same bytes.
        let (start, size) = window;
        let mut part = vec![0xee; size];
        let mut w = Writer::window(&mut part, start);
        body.encode(&mut w).unwrap();
        prop_assert_eq!(w.len(), buf.len());
        let shown = buf.get(start..).unwrap_or(&[]);
        let shown = &shown[..shown.len().min(size)];
        prop_assert_eq!(&part[..shown.len()], shown);

        // One byte less is an error, not a panic, in either direction.
        if let Some(short) = buf.len().checked_sub(1) {
            prop_assert!(body.encode(&mut Writer::new(&mut vec![0; short])).is_err());
            if let Ok(shorter) = Body::decode(body.id(), body.flags() | 1, &buf[..short]) {
                prop_assert_eq!(encoded(&shorter), &buf[..short]);
            }
        }
    }

    #[test]
    fn every_message(
        header in (any::<u8>(), any::<u8>(), any::<u16>(), any::<[u8; 4]>()),
        bodies in vec(any_body(), 0..6),
        padded in any::<bool>(),
    ) {
        let (session, stream, seq, key) = header;
        let (session, stream) = (SessionId(session), StreamId(stream));
        let header = Header::new(session, stream, SeqNum(seq), ClientKey(key));
        let mut buf = [0xaa; 8192];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        let mut len = header.session.header_len();
        for body in &bodies {
            len = len.next_multiple_of(4) + submessage_len(body).unwrap();
            if padded { message.push_padded(body) } else { message.push(body) }.unwrap();
        }
        let bytes = message.finish();
        prop_assert!(bytes.len() == len || !padded && bytes.len() + 3 >= len);
        let parsed = Message::parse(bytes).unwrap();
        prop_assert_eq!(parsed.header, header);
        let got: Vec<_> = parsed.submessages().map(Result::unwrap).collect();
        prop_assert_eq!(got.len(), bodies.len());
        for (submessage, body) in got.iter().zip(&bodies) {
            prop_assert_eq!(submessage.id, body.id());
            prop_assert_eq!(comparable(submessage.body().unwrap()), comparable(*body));
        }
    }
}

/// The generators above leave nothing out.
#[test]
fn every_kind_is_generated() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut kinds = BTreeSet::new();
    for _ in 0..2_000 {
        let body = any_body().new_tree(&mut runner).unwrap().current();
        kinds.insert(body.id() as u8);
    }
    let all = (0..=15).filter(|number| SubmessageId::from_number(*number).is_ok());
    assert_eq!(kinds, all.collect());
}

/// A delivery control as an appendable struct (Annex B.4.2), with its length before it: the default
/// of `zerodds-xrce-client`.
#[test]
fn a_delivery_control_with_its_length() {
    let control = [0xff, 0xff, 1, 0, 2, 0, 3, 0];
    let bare = [&[0, 10, 0, 0x16, 0x80, 0, 0, 1], &control[..]].concat();
    let appendable = [&[0, 10, 0, 0x16, 0x80, 0, 0, 1, 8, 0, 0, 0], &control[..]].concat();
    let bare = Body::decode(SubmessageId::ReadData, 1, &bare).unwrap();
    assert_eq!(
        Body::decode(SubmessageId::ReadData, 1, &appendable),
        Ok(bare)
    );
    let Body::ReadData(read) = bare else {
        panic!("{bare:?}")
    };
    let expected = DeliveryControl {
        max_samples: 0xffff,
        max_elapsed_s: 1,
        max_bytes_per_second: 2,
        min_pace_ms: 3,
    };
    assert_eq!(read.control, Some(expected));
    // Eight samples at most, bare: nothing else starts like a length.
    let eight = [0, 10, 0, 0x16, 0x80, 0, 0, 1, 8, 0, 0, 0, 2, 0, 3, 0];
    let Ok(Body::ReadData(read)) = Body::decode(SubmessageId::ReadData, 1, &eight) else {
        panic!()
    };
    assert_eq!(read.control.unwrap().max_samples, 8);
}

/// The same of ACKNACK and HEARTBEAT. A bare body has five bytes and is never taken for that form.
#[test]
fn an_acknack_and_a_heartbeat_with_their_length() {
    for id in [SubmessageId::AckNack, SubmessageId::Heartbeat] {
        for first in [0, 5, 0x80] {
            let bare = [first, 0, 0, 0, 0x80];
            let decoded = Body::decode(id, 1, &bare).unwrap();
            let appendable = [&[5, 0, 0, 0], &bare[..]].concat();
            assert_eq!(Body::decode(id, 1, &appendable), Ok(decoded));
            assert_eq!(encoded(&decoded), bare);
        }
    }
}

//! Samples that the 16 bits of a submessage's length cannot hold: they go in fragments, with 0 for
//! the length, as eProsima's client and agent do it.

use replenish_xrce::SeqNum;
use replenish_xrce::stream::{
    InputReliable, OutputReliable, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Data, Encode, Message, ObjectId, ObjectKind, RequestId,
    SessionId, StreamId, SubmessageId, WireError, WriteData, Writer,
};

const MTU: usize = 512;
const LONGEST: usize = 200_000;
const MILLI: u64 = 1_000_000;

type Output = OutputReliable<Vec<u8>, 16>;
type Input = InputReliable<Vec<u8>, Vec<u8>, 16>;

fn output(tail: Tail) -> Output {
    let header = StreamHeader {
        session: SessionId(0x81),
        stream: StreamId::RELIABLE,
        key: ClientKey([0; 4]),
    };
    OutputReliable::new(vec![0; 16 * MTU], MTU, header, tail, Reliability::default())
        .with_spill(vec![0; LONGEST + 8])
}

fn input() -> Input {
    let slots = vec![0; 16 * MTU];
    InputReliable::new(StreamId::RELIABLE, slots, MTU, vec![0; LONGEST + 8])
}

fn base(kind: ObjectKind) -> BaseRequest {
    BaseRequest {
        request: RequestId::FIRST,
        object: ObjectId::new(1, kind),
    }
}

fn sample(number: usize, len: usize) -> Vec<u8> {
    (0..len)
        .map(|at| (at * 31 + at / 509 + number) as u8)
        .collect()
}

/// A body as client or agent sends it.
fn push(output: &mut Output, tail: Tail, payload: &[u8]) -> Result<(), PushError> {
    match tail {
        Tail::Padded => output.push(&WriteData {
            base: base(ObjectKind::DataWriter),
            payload,
        }),
        Tail::Exact => output.push(&Data {
            base: base(ObjectKind::DataReader),
            payload,
        }),
    }
}

/// Every seventh datagram is lost, in either direction.
#[test]
#[cfg_attr(not(feature = "fragments"), ignore = "needs the feature `fragments`")]
fn samples_of_any_length_come_whole_over_a_bad_link() {
    let lens = [
        65_530, 12, 65_531, 65_532, 65_533, 0, 65_534, 150_001, 7, LONGEST,
    ];
    for tail in [Tail::Padded, Tail::Exact] {
        let (mut output, mut input) = (output(tail), input());
        let (mut got, mut next, mut now, mut sent) = (Vec::new(), 0, 0, 0_u32);
        while got.len() < lens.len() || !output.is_idle() {
            assert!(now < 600_000 * MILLI, "{} came", got.len());
            if next < lens.len() && push(&mut output, tail, &sample(next, lens[next])).is_ok() {
                next += 1;
            }
            while let Some(bytes) = output.next_datagram(now) {
                sent += 1;
                let message = Message::parse(bytes).unwrap();
                if sent % 7 != 3 {
                    input.receive(message.header.seq, message.body, |submessage| {
                        got.push(match submessage.body().unwrap() {
                            Body::WriteData(body) => body.payload.to_vec(),
                            Body::Data(body) => body.payload.to_vec(),
                            other => panic!("{other:?}"),
                        });
                    });
                }
            }
            if let Some(heartbeat) = output.take_heartbeat(now) {
                input.heartbeat(heartbeat.last);
            }
            sent += 1;
            if let Some(ack) = input.take_ack().filter(|_| sent % 7 != 3) {
                output.acknowledge(now, ack.first_unacked, ack.missing);
            }
            now += MILLI;
        }
        for (number, len) in lens.into_iter().enumerate() {
            assert!(
                got[number] == sample(number, len),
                "{number} of {len} bytes, {tail:?}"
            );
        }
        assert_eq!((input.stats().malformed, input.stats().too_long), (0, 0));
    }
}

/// The first fragment says 0 where the length does not fit, and nothing is padded: what is joined
/// ends with the sample.
#[test]
#[cfg_attr(not(feature = "fragments"), ignore = "needs the feature `fragments`")]
fn a_long_sample_has_no_length_and_no_padding() {
    for (len, length, joined) in [(65_531, [0xff, 0xff], 65_540), (65_533, [0, 0], 65_541)] {
        let mut output = output(Tail::Padded);
        push(&mut output, Tail::Padded, &sample(0, len)).unwrap();
        let last = output.newest();
        let (mut whole, mut seq) = (Vec::new(), SeqNum(0));
        while !output.is_idle() {
            let message = Message::parse(output.next_datagram(0).unwrap()).unwrap();
            let fragment = message.submessages().next().unwrap().unwrap();
            assert_eq!(fragment.id, SubmessageId::Fragment);
            whole.extend_from_slice(fragment.payload);
            seq = message.header.seq;
            output.acknowledge(0, seq.plus(1), 0);
        }
        assert_eq!(
            whole[..4],
            [SubmessageId::WriteData as u8, 1, length[0], length[1]]
        );
        assert_eq!((whole.len(), seq), (joined, last), "{len}");
    }
}

#[test]
#[cfg_attr(not(feature = "fragments"), ignore = "needs the feature `fragments`")]
fn what_is_too_long_is_refused() {
    let mut output = output(Tail::Padded);
    let (size, limit) = (LONGEST + 9, LONGEST + 8);
    let refused = push(&mut output, Tail::Padded, &sample(0, LONGEST + 1));
    assert_eq!(refused, Err(PushError::TooLarge { size, limit }));
    // Other submessages have a length.
    struct Long;
    impl Encode for Long {
        fn id(&self) -> SubmessageId {
            SubmessageId::Create
        }
        fn write(&self, w: &mut Writer<'_>) {
            w.put(&[0; 65_536]);
        }
    }
    let refused = output.push(&Long);
    assert_eq!(
        refused,
        Err(PushError::Wire(WireError::TooLong { len: 65_536 }))
    );
    // Numbers of messages are compared over half a round.
    let header = output.header();
    let (mtu, spill) = (16, vec![0; LONGEST * 8]);
    let reliability = Reliability::default();
    let mut narrow =
        Output::new(vec![0; 16 * mtu], mtu, header, Tail::Padded, reliability).with_spill(spill);
    let limit = 32_000 * (mtu - 8);
    assert_eq!(narrow.limit(), limit);
    let refused = push(&mut narrow, Tail::Padded, &sample(0, limit - 7));
    assert_eq!(
        refused,
        Err(PushError::TooLarge {
            size: limit + 1,
            limit
        })
    );
    push(&mut narrow, Tail::Padded, &sample(0, limit - 8)).unwrap();
    assert_eq!(narrow.newest(), SeqNum(31_999));
}

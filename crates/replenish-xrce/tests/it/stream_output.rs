//! Output streams one step at a time: packing, limits, windows, repair, heartbeats.

use proptest::prelude::*;
use replenish_xrce::SeqNum;
use replenish_xrce::stream::{
    InputReliable, OutputBestEffort, OutputReliable, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{
    BaseRequest, ClientKey, Heartbeat, Message, ObjectId, ObjectKind, RequestId, SessionId,
    StreamId, SubmessageId, WriteData,
};

const MTU: usize = 64;
const MILLI: u64 = 1_000_000;

fn header(stream: StreamId) -> StreamHeader {
    StreamHeader {
        session: SessionId(0x81),
        stream,
        key: ClientKey([0; 4]),
    }
}

fn reliable() -> OutputReliable<[u8; 4 * MTU], 4> {
    let header = header(StreamId::RELIABLE);
    OutputReliable::new(
        [0; 4 * MTU],
        MTU,
        header,
        Tail::Padded,
        Reliability::EPROSIMA,
    )
}

fn write(payload: &[u8]) -> WriteData<'_> {
    let object = ObjectId::new(1, ObjectKind::DataWriter);
    WriteData {
        base: BaseRequest {
            request: RequestId::FIRST,
            object,
        },
        payload,
    }
}

fn seq(datagram: Option<&[u8]>) -> Option<u16> {
    datagram.map(|bytes| Message::parse(bytes).unwrap().header.seq.0)
}

#[test]
fn submessages_are_packed_until_the_message_is_sent() {
    let mut stream = reliable();
    for _ in 0..2 {
        stream.push(&write(&[1; 9])).unwrap();
    }
    assert_eq!(stream.free(), 3);
    let message = Message::parse(stream.next_datagram(0).unwrap()).unwrap();
    assert_eq!(message.submessages().count(), 2);
    assert_eq!(message.body.len(), 2 * 20);
    stream.push(&write(&[2; 9])).unwrap();
    assert_eq!(seq(stream.next_datagram(0)), Some(1));
    assert_eq!(stream.next_datagram(0), None);
}

#[test]
#[cfg_attr(not(feature = "fragments"), ignore = "needs the feature `fragments`")]
fn a_full_window_would_block_and_too_large_names_the_limit() {
    let mut stream = reliable();
    let piece = MTU - 4 - 4;
    // Three fragments: 8 bytes of headers in the submessage.
    stream.push(&write(&vec![0; 3 * piece - 8])).unwrap();
    assert_eq!(stream.free(), 1);
    assert_eq!(
        stream.push(&write(&vec![0; 2 * piece - 8])),
        Err(PushError::WouldBlock)
    );
    let (size, limit) = (4 * piece + 4, 4 * piece);
    assert_eq!(
        stream.push(&write(&vec![0; size - 8])),
        Err(PushError::TooLarge { size, limit })
    );
    assert_eq!(stream.limit(), limit);
    // A sample too large for the fragments now still leaves room for a small one.
    stream.push(&write(&[0; 4])).unwrap();
    assert_eq!(stream.free(), 0);
    let mut ids = Vec::new();
    while let Some(bytes) = stream.next_datagram(0) {
        let message = Message::parse(bytes).unwrap();
        let submessage = message.submessages().next().unwrap().unwrap();
        ids.push((submessage.id, submessage.flags, submessage.payload.len()));
    }
    assert_eq!(
        ids,
        [
            (SubmessageId::Fragment, 1, piece),
            (SubmessageId::Fragment, 1, piece),
            (SubmessageId::Fragment, 3, piece),
            (SubmessageId::WriteData, 1, 8),
        ]
    );
    stream.acknowledge(0, SeqNum(2), 0);
    assert_eq!(stream.free(), 2);
    stream.push(&write(&vec![0; 2 * piece - 8])).unwrap();
    stream.acknowledge(0, SeqNum(4), 0);
    stream.next_datagram(0).unwrap();
    stream.next_datagram(0).unwrap();
    stream.acknowledge(0, SeqNum(6), 0);
    assert!(stream.is_idle());
}

#[test]
#[cfg_attr(not(feature = "rtt"), ignore = "needs the feature `rtt`")]
fn only_the_missing_ones_are_sent_again_and_once_per_round_trip() {
    let mut stream = reliable();
    for n in 0..4 {
        stream.push(&write(&[n; 48])).unwrap();
        assert_eq!(seq(stream.next_datagram(0)), Some(u16::from(n)));
    }
    stream.acknowledge(MILLI, SeqNum(1), 0b101); // 1 and 3 are missing, 2 has arrived
    assert_eq!(seq(stream.next_datagram(3 * MILLI)), Some(1));
    assert_eq!(seq(stream.next_datagram(3 * MILLI)), Some(3));
    assert_eq!(stream.next_datagram(3 * MILLI), None);
    // The same gap again, too early to be about the second transmission.
    stream.acknowledge(3 * MILLI, SeqNum(1), 0b101);
    assert_eq!(stream.next_datagram(3 * MILLI + 1), None);
    // By now an acknowledgement would be here.
    assert_eq!(seq(stream.next_datagram(9 * MILLI)), Some(1));
    stream.acknowledge(10 * MILLI, SeqNum(4), 0);
    assert_eq!(stream.next_datagram(20 * MILLI), None);
    assert!(stream.is_idle());
    assert_eq!(stream.stats().resent, 3);
}

#[test]
fn the_window_holds_new_messages_back() {
    let config = Reliability {
        in_flight: 2,
        ..Reliability::EPROSIMA
    };
    let header = header(StreamId::RELIABLE);
    let mut stream: OutputReliable<_, 4> =
        OutputReliable::new([0; 4 * MTU], MTU, header, Tail::Padded, config);
    for _ in 0..4 {
        stream.push(&write(&[0; 48])).unwrap();
    }
    assert_eq!(
        (seq(stream.next_datagram(0)), seq(stream.next_datagram(0))),
        (Some(0), Some(1))
    );
    assert!(!stream.has_message(0));
    stream.acknowledge(0, SeqNum(1), 0);
    assert_eq!(
        (seq(stream.next_datagram(0)), seq(stream.next_datagram(0))),
        (Some(2), None)
    );
}

#[test]
fn heartbeats_come_while_something_is_unacknowledged() {
    let mut stream = reliable();
    assert_eq!(stream.next_deadline(), None);
    stream.push(&write(&[0; 48])).unwrap();
    stream.push(&write(&[0; 48])).unwrap();
    assert_eq!(stream.next_deadline(), None);
    stream.next_datagram(MILLI).unwrap();
    stream.next_datagram(MILLI).unwrap();
    assert_eq!(stream.next_deadline(), Some(101 * MILLI));
    assert_eq!(stream.take_heartbeat(101 * MILLI - 1), None);
    let heartbeat = Heartbeat {
        first: SeqNum(0),
        last: SeqNum(1),
        stream: StreamId::RELIABLE,
    };
    assert_eq!(stream.take_heartbeat(101 * MILLI), Some(heartbeat));
    assert_eq!(stream.take_heartbeat(101 * MILLI), None);
    stream.acknowledge(102 * MILLI, SeqNum(7), 0); // of messages never sent
    assert_eq!(stream.stats().bogus_acks, 1);
    stream.acknowledge(102 * MILLI, SeqNum(2), 0);
    assert_eq!(stream.next_deadline(), None);
}

#[test]
fn best_effort_packs_and_has_one_message_at_a_time() {
    let header = header(StreamId::BEST_EFFORT);
    let mut stream = OutputBestEffort::new([0; 2 * MTU], header, Tail::Exact).limited(MTU);
    assert_eq!(
        stream.push(&write(&[0; 60])),
        Err(PushError::TooLarge {
            size: 68,
            limit: 60
        })
    );
    stream.push(&write(&[1; 21])).unwrap();
    assert_eq!(stream.push(&write(&[2; 30])), Err(PushError::WouldBlock));
    stream.push(&write(&[3; 3])).unwrap();
    let message = stream.take().unwrap();
    assert_eq!(message.len(), 4 + 32 + 8 + 3);
    assert_eq!(stream.take(), None);
    stream.push(&write(&[2; 30])).unwrap();
    assert_eq!(seq(stream.take()), Some(1));
}

#[test]
fn storage_too_small_for_one_message_is_a_stream_that_takes_nothing() {
    let header = header(StreamId::RELIABLE);
    let mut stream: OutputReliable<_, 4> =
        OutputReliable::new([0; 8], MTU, header, Tail::Padded, Reliability::default());
    assert_eq!(
        stream.push(&write(&[0; 4])),
        Err(PushError::TooLarge { size: 12, limit: 0 })
    );
    let mut input: InputReliable<_, _, 4> =
        InputReliable::new(StreamId::RELIABLE, [0; 8], MTU, [0; 0]);
    input.receive(SeqNum(1), &[5, 1, 0, 0], |_| {
        panic!("nothing is in order yet")
    });
    assert_eq!(input.stats().dropped, 1);
    assert_eq!(input.ack().missing, 1);
}

/// Anything a peer could do to the machines.
#[derive(Clone, Debug)]
enum Attack {
    Ack(u16, u16),
    Heartbeat(u16),
    Message(u16, Vec<u8>),
    Push(usize),
    Send,
    Wait(u64),
}

fn attack() -> impl Strategy<Value = Attack> {
    let near = prop_oneof![0_u16..20, 65_520_u16..=65_535, any::<u16>()];
    prop_oneof![
        (near.clone(), any::<u16>()).prop_map(|(first, missing)| Attack::Ack(first, missing)),
        near.clone().prop_map(Attack::Heartbeat),
        (
            near,
            prop::collection::vec(prop_oneof![Just(13_u8), 0_u8..16, any::<u8>()], 0..80)
        )
            .prop_map(|(seq, body)| Attack::Message(seq, body)),
        (0_usize..300).prop_map(Attack::Push),
        Just(Attack::Send),
        (0_u64..200 * MILLI).prop_map(Attack::Wait),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3_000, ..ProptestConfig::default() })]

    #[test]
    fn no_peer_makes_the_machines_panic(attacks in prop::collection::vec(attack(), 0..60)) {
        let mut output = reliable();
        let mut input: InputReliable<_, _, 4> =
            InputReliable::new(StreamId::RELIABLE, [0; 4 * MTU], MTU, [0; 100]);
        let mut now = 0_u64;
        for attack in attacks {
            match attack {
                Attack::Ack(first, missing) => output.acknowledge(now, SeqNum(first), missing),
                Attack::Heartbeat(last) => input.heartbeat(SeqNum(last)),
                Attack::Message(seq, body) => input.receive(SeqNum(seq), &body, |submessage| {
                    std::hint::black_box(&submessage.body());
                }),
                Attack::Push(len) => drop(std::hint::black_box(output.push(&write(&vec![0; len])))),
                Attack::Send => {
                    if let Some(bytes) = output.next_datagram(now) {
                        prop_assert!(Message::parse(bytes).unwrap().submessages().all(|s| s.is_ok()));
                    }
                }
                Attack::Wait(time) => now += time,
            }
            prop_assert!(output.free() <= 4);
            prop_assert_eq!(input.ack().first_unacked, input.next_expected());
            std::hint::black_box((output.take_heartbeat(now), output.next_deadline(), input.take_ack()));
        }
    }
}

//! The pace of reliable streams: repairs and their repetitions, heartbeats, acknowledgements that
//! wait, and what a peer may say about messages. Each test holds one rule that a change of one line
//! breaks.

use replenish_xrce::SeqNum;
use replenish_xrce::stream::{
    AckPolicy, InputReliable, OutputReliable, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{
    BaseRequest, ClientKey, Message, ObjectId, ObjectKind, RequestId, SessionId, StreamId,
    WriteData,
};

const MTU: usize = 64;
const MILLI: u64 = 1_000_000;

type Output = OutputReliable<[u8; 20 * MTU], 20>;
type Input = InputReliable<[u8; 20 * MTU], [u8; 256], 20>;

fn output(config: Reliability) -> Output {
    let header = StreamHeader {
        session: SessionId(0x81),
        stream: StreamId::RELIABLE,
        key: ClientKey([0; 4]),
    };
    OutputReliable::new([0; 20 * MTU], MTU, header, Tail::Padded, config)
}

fn input(acks: AckPolicy) -> Input {
    InputReliable::new(StreamId::RELIABLE, [0; 20 * MTU], MTU, [0; 256]).acknowledging(acks)
}

/// A message of its own: another one does not fit beside it.
fn push(stream: &mut Output) {
    let object = ObjectId::new(1, ObjectKind::DataWriter);
    let request = RequestId::FIRST;
    let base = BaseRequest { request, object };
    let payload = &[0; 48];
    stream.push(&WriteData { base, payload }).unwrap();
}

/// The numbers of the messages that are sent now.
fn sent(stream: &mut Output, now: u64) -> Vec<u16> {
    core::iter::from_fn(|| {
        let bytes = stream.next_datagram(now)?;
        Some(Message::parse(bytes).unwrap().header.seq.0)
    })
    .collect()
}

fn send(stream: &mut Output, count: usize, now: u64) -> Vec<u16> {
    (0..count).for_each(|_| push(stream));
    sent(stream, now)
}

/// A stream that knows a round trip of 1 ms: message 0 was answered by then.
fn measured() -> Output {
    let mut stream = output(Reliability::default());
    assert_eq!(send(&mut stream, 1, 0), [0]);
    stream.acknowledge(MILLI, SeqNum(1), 0);
    assert!(stream.is_idle());
    stream
}

/// From sending a message until its first heartbeat.
fn patience(stream: &mut Output, now: u64) -> u64 {
    assert_eq!(send(stream, 1, now).len(), 1);
    stream.next_deadline().unwrap() - now
}

#[test]
fn a_repair_is_repeated_three_times_at_growing_distances() {
    let mut stream = output(Reliability::EPROSIMA);
    assert_eq!(send(&mut stream, 2, 0), [0, 1]);
    stream.acknowledge(MILLI, SeqNum(0), 0b01);
    let mut times = Vec::new();
    for tick in 0..200 {
        let now = tick * 10 * MILLI;
        times.extend(sent(&mut stream, now).iter().map(|seq| (*seq, tick * 10)));
    }
    let first = times.first().copied().unwrap();
    assert_eq!(first.0, 0);
    let after: Vec<u64> = times.iter().map(|(_, at)| at - first.1).collect();
    let step = after.get(1).copied().unwrap();
    assert_eq!(after, [0, step, 3 * step, 6 * step], "{times:?}");
    assert!(step > 0);
    assert!(times.iter().all(|(seq, _)| *seq == 0), "1 has arrived");
    assert_eq!(stream.stats().resent, 4);
    // Named missing once more: the repetitions begin anew.
    stream.acknowledge(5_000 * MILLI, SeqNum(0), 0b01);
    assert_eq!(sent(&mut stream, 6_000 * MILLI), [0]);
    assert_eq!(sent(&mut stream, 6_200 * MILLI), [0]);
}

#[test]
fn a_message_that_has_arrived_is_not_sent_again_whatever_a_late_acknowledgement_says() {
    let mut stream = output(Reliability::EPROSIMA);
    assert_eq!(send(&mut stream, 4, 0), [0, 1, 2, 3]);
    stream.acknowledge(MILLI, SeqNum(1), 0b101); // 2 has arrived
    stream.acknowledge(2 * MILLI, SeqNum(1), 0b111); // sent before that one
    assert_eq!(sent(&mut stream, 1_000 * MILLI), [1, 3]);
}

#[test]
fn the_sixteenth_message_of_a_window_is_named_and_repaired() {
    let mut receiver = input(AckPolicy::IMMEDIATE);
    receiver.heartbeat(SeqNum(15));
    let ack = receiver.take_ack().unwrap();
    assert_eq!((ack.first_unacked, ack.missing), (SeqNum(0), 0xffff));
    let mut stream = output(Reliability::EPROSIMA);
    assert_eq!(send(&mut stream, 16, 0).len(), 16);
    stream.acknowledge(MILLI, SeqNum(0), 0x8001);
    assert_eq!(sent(&mut stream, 1_000 * MILLI), [0, 15]);
    // All between have arrived: with the two, the window is empty.
    stream.acknowledge(1_001 * MILLI, SeqNum(16), 0);
    assert!(stream.is_idle());
}

#[test]
fn messages_that_were_not_sent_cannot_be_acknowledged() {
    let mut stream = output(Reliability {
        in_flight: 1,
        ..Reliability::EPROSIMA
    });
    assert_eq!(send(&mut stream, 3, 0), [0]);
    stream.acknowledge(MILLI, SeqNum(2), 0); // 1 waits in the stream
    assert_eq!(stream.stats().bogus_acks, 1);
    assert_eq!(stream.first_unacknowledged(), SeqNum(0));
    stream.acknowledge(2 * MILLI, SeqNum(1), 0);
    assert_eq!(sent(&mut stream, 2 * MILLI), [1]);
    stream.acknowledge(3 * MILLI, SeqNum(2), 0);
    assert_eq!(sent(&mut stream, 3 * MILLI), [2]);
    assert_eq!(stream.stats().bogus_acks, 1);
}

#[test]
#[cfg_attr(not(feature = "delivery"), ignore = "needs the feature `delivery`")]
fn confirmations_go_forward_alone_and_up_to_what_was_acknowledged() {
    let mut stream = output(Reliability::EPROSIMA).keeping_whole_samples();
    stream.until_confirmed(true);
    assert_eq!(send(&mut stream, 4, 0).len(), 4);
    stream.confirm(MILLI, SeqNum(1)); // nothing was acknowledged yet
    assert_eq!((stream.stats().bogus_acks, stream.unacknowledged()), (1, 4));
    stream.acknowledge(2 * MILLI, SeqNum(3), 0);
    assert_eq!(stream.unacknowledged(), 4, "kept until confirmed");
    stream.confirm(3 * MILLI, SeqNum(2));
    assert_eq!(stream.unacknowledged(), 2);
    stream.confirm(4 * MILLI, SeqNum(1)); // an older one comes late
    assert_eq!(stream.unacknowledged(), 2);
    stream.confirm(5 * MILLI, SeqNum(4)); // 3 is not acknowledged
    assert_eq!((stream.stats().bogus_acks, stream.unacknowledged()), (2, 2));
    stream.acknowledge(6 * MILLI, SeqNum(4), 0);
    stream.confirm(6 * MILLI, SeqNum(4));
    assert!(stream.is_idle());
}

#[test]
#[cfg_attr(
    not(all(feature = "delivery", feature = "fragments")),
    ignore = "needs the features `delivery` and `fragments`"
)]
fn a_confirmation_that_comes_late_takes_nothing_back() {
    // Three fragments of one sample: they are kept until all of them are confirmed.
    let mut stream = output(Reliability::EPROSIMA).keeping_whole_samples();
    stream.until_confirmed(true);
    let object = ObjectId::new(1, ObjectKind::DataWriter);
    let request = RequestId::FIRST;
    let base = BaseRequest { request, object };
    let payload = &[0; 140];
    stream.push(&WriteData { base, payload }).unwrap();
    assert_eq!(sent(&mut stream, 0), [0, 1, 2]);
    stream.acknowledge(MILLI, SeqNum(3), 0);
    stream.confirm(2 * MILLI, SeqNum(2));
    assert_eq!(stream.unacknowledged(), 1);
    stream.confirm(3 * MILLI, SeqNum(1));
    assert_eq!(stream.unacknowledged(), 1, "2 of 3 stay confirmed");
    stream.confirm(4 * MILLI, SeqNum(3));
    assert!(stream.is_idle());
}

#[test]
fn heartbeats_slow_down_without_an_answer_and_an_answer_makes_them_quick_again() {
    let mut stream = output(Reliability::default());
    assert_eq!(send(&mut stream, 2, 0), [0, 1]);
    let mut times = Vec::new();
    while times.len() < 9 {
        let at = stream.next_deadline().unwrap();
        assert_eq!(stream.take_heartbeat(at - 1), None);
        assert!(stream.take_heartbeat(at).is_some());
        times.push(at / MILLI);
    }
    assert_eq!(times, [10, 20, 30, 50, 90, 170, 270, 370, 470]);
    // An answer without news changes nothing; one with news begins anew.
    let mut stream = measured();
    let quick = patience(&mut stream, 10 * MILLI);
    let mut last = 0;
    while last < 1_000 * MILLI {
        last = stream.next_deadline().unwrap();
        stream.take_heartbeat(last).unwrap();
    }
    stream.acknowledge(last, SeqNum(1), 0b1);
    sent(&mut stream, last); // repaired
    assert_eq!(stream.take_heartbeat(last + 99 * MILLI), None);
    stream.acknowledge(last + 99 * MILLI, SeqNum(2), 0);
    let now = last + 100 * MILLI;
    let again = patience(&mut stream, now);
    assert!(
        again <= 10 * MILLI && again <= 2 * quick,
        "{again}, {quick}"
    );
    // Before the pace slows down, heartbeats come at the same distance.
    let first = stream.next_deadline().unwrap();
    stream.take_heartbeat(first).unwrap();
    assert_eq!(stream.next_deadline(), Some(first + again));
}

/// Karn's rule: the answer to a message that was sent twice may be to either.
#[test]
#[cfg_attr(not(feature = "rtt"), ignore = "needs the feature `rtt`")]
fn a_message_that_was_sent_twice_measures_no_round_trip() {
    let mut stream = measured();
    let known = patience(&mut stream, 2 * MILLI);
    stream.acknowledge(3 * MILLI, SeqNum(1), 0b1);
    assert_eq!(sent(&mut stream, 40 * MILLI), [1]);
    stream.acknowledge(80 * MILLI, SeqNum(2), 0); // 40 ms after the second, 78 after the first
    assert_eq!(patience(&mut stream, 100 * MILLI), known);
    stream.acknowledge(101 * MILLI, SeqNum(3), 0);
    // One that was sent once does: 9 ms instead of 1.
    assert_eq!(send(&mut stream, 1, 110 * MILLI), [3]);
    stream.acknowledge(119 * MILLI, SeqNum(4), 0);
    assert!(patience(&mut stream, 120 * MILLI) > known);
}

#[test]
fn a_duplicate_a_gap_and_a_heartbeat_are_answered_at_once() {
    let acks = AckPolicy {
        every: 8,
        delay: 5 * MILLI,
    };
    let body = [0; 0];
    let mut stream = input(acks);
    stream.receive(SeqNum(0), &body, |_| ());
    assert_eq!(stream.take_ack_at(0), None, "it can wait");
    assert_eq!(stream.take_ack_at(5 * MILLI - 1), None);
    assert!(stream.take_ack_at(5 * MILLI).is_some());
    // The acknowledgement was lost, and the sender repeats what it has not heard of.
    stream.receive(SeqNum(0), &body, |_| ());
    assert!(stream.is_urgent());
    assert!(stream.take_ack_at(6 * MILLI).is_some(), "a duplicate");
    assert!(!stream.is_urgent());
    stream.receive(SeqNum(2), &body, |_| ());
    let ack = stream.take_ack_at(7 * MILLI).unwrap();
    assert_eq!((ack.first_unacked, ack.missing), (SeqNum(1), 0b1), "a gap");
    stream.receive(SeqNum(1), &body, |_| ());
    assert_eq!(stream.take_ack_at(8 * MILLI), None);
    stream.heartbeat(SeqNum(2));
    assert!(stream.take_ack_at(8 * MILLI).is_some(), "a heartbeat");
    // The eighth message does not wait either.
    for seq in 3..10 {
        stream.receive(SeqNum(seq), &body, |_| ());
        assert_eq!(stream.take_ack_at(9 * MILLI), None, "{seq}");
    }
    stream.receive(SeqNum(10), &body, |_| ());
    assert!(stream.take_ack_at(9 * MILLI).is_some());
}

#[test]
fn a_reset_forgets_what_was_announced_kept_and_to_be_acknowledged() {
    let mut stream = input(AckPolicy::IMMEDIATE);
    stream.heartbeat(SeqNum(5));
    stream.receive(SeqNum(3), &[0; 0], |_| ());
    assert_eq!(stream.ack().missing, 0b11_0111);
    stream.heartbeat(SeqNum(2)); // an older one comes late
    assert_eq!(stream.ack().missing, 0b11_0111);
    stream.reset();
    assert!(!stream.ack_due());
    let ack = stream.ack();
    assert_eq!((ack.first_unacked, ack.missing), (SeqNum(0), 0));
    let mut delivered = 0;
    // `WRITE_DATA` of nothing: what was kept does not follow it.
    stream.receive(SeqNum(0), &[7, 1, 0, 0], |_| delivered += 1);
    assert_eq!((delivered, stream.next_expected()), (1, SeqNum(1)));
    stream.receive(SeqNum(2), &[0; 0], |_| ());
    assert_eq!(stream.ack().missing, 0b1);
    stream.receive(SeqNum(1), &[0; 0], |_| ());
    assert_eq!(
        stream.next_expected(),
        SeqNum(3),
        "3 was of the last session"
    );
}

#[test]
#[cfg_attr(not(feature = "rtt"), ignore = "needs the feature `rtt`")]
fn a_reset_forgets_the_round_trip() {
    let mut stream = measured();
    let header = stream.header();
    stream.reset(header);
    let at = 100 * MILLI;
    assert_eq!(send(&mut stream, 1, at), [0]);
    stream.acknowledge(at + MILLI, SeqNum(0), 0b1);
    // As long as none was measured an answer may take twice the time to the first heartbeat.
    assert_eq!(sent(&mut stream, at + 20 * MILLI - 1), [0_u16; 0]);
    assert_eq!(sent(&mut stream, at + 20 * MILLI), [0]);
}

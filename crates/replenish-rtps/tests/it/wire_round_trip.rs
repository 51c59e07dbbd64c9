//! Every submessage survives writing and reading, and damage to it is an error or another value.

use proptest::prelude::*;
use replenish_rtps::wire::{
    AckNack, Bits, Data, DataFrag, EndpointData, EntityId, FragmentSet, Gap, GuidPrefix, Heartbeat,
    HeartbeatFrag, MAX_SEQUENCE_NUMBER, Message, MessageWriter, NackFrag, ParticipantData, Payload,
    Reference, SequenceSet, SharedPlace, Submessage, Timestamp,
};

const PREFIX: GuidPrefix = GuidPrefix([7; 12]);

fn entity() -> impl Strategy<Value = EntityId> {
    any::<[u8; 4]>().prop_map(EntityId)
}

fn number() -> impl Strategy<Value = i64> {
    prop_oneof![1..300i64, 1..=MAX_SEQUENCE_NUMBER]
}

fn bits() -> impl Strategy<Value = Bits> {
    prop::collection::btree_set(0..256u32, 0..40).prop_map(|set| {
        let mut bits = Bits::EMPTY;
        for at in set {
            assert!(bits.set(at));
        }
        bits
    })
}

fn set() -> impl Strategy<Value = SequenceSet> {
    (number(), bits()).prop_map(|(base, bits)| SequenceSet { base, bits })
}

fn written(write: impl FnOnce(&mut MessageWriter<'_>)) -> Vec<u8> {
    let mut buf = vec![0; 2048];
    let mut m = MessageWriter::new(&mut buf, PREFIX).unwrap();
    write(&mut m);
    assert_eq!(m.len() % 4, 0);
    m.message().to_vec()
}

/// The only submessage.
fn read(bytes: &[u8]) -> Submessage<'_> {
    let message = Message::decode(bytes).unwrap();
    assert_eq!(message.prefix, PREFIX);
    let mut parts = message.submessages();
    let part = parts.next().unwrap().unwrap();
    assert!(parts.next().is_none());
    part
}

proptest! {
    #[test]
    fn references(reader in entity(), writer in entity(), sn in number(), size in 1..u32::MAX,
                  slot: u32, stamp: u64, fragment_size in 1..u16::MAX) {
        let place = SharedPlace { slot, stamp };
        let body = Reference { reader, writer, sn, sample_size: size, place, fragment_size, inline_qos: None };
        let mut bytes = written(|m| m.reference(&body, &[]).unwrap());
        let Submessage::Reference(b) = read(&bytes) else { panic!("a reference") };
        prop_assert_eq!((b.reader, b.writer, b.sn), (reader, writer, sn));
        prop_assert_eq!((b.sample_size, b.place, b.fragment_size), (size, place, fragment_size));
        prop_assert!(b.inline_qos.is_none());
        // Of another vendor, the same number means something else.
        bytes[6..8].copy_from_slice(&[1, 15]);
        prop_assert!(matches!(read(&bytes), Submessage::Other(0x90)));
    }

    #[test]
    fn whether_references_are_taken(reader in entity(), writer in entity(), taken: bool) {
        let mut bytes = written(|m| m.shared(reader, writer, taken).unwrap());
        let Submessage::Shared(b) = read(&bytes) else { panic!("an answer") };
        prop_assert_eq!((b.reader, b.writer, b.taken), (reader, writer, taken));
        bytes[24] ^= 1;
        prop_assert!(matches!(read(&bytes), Submessage::Other(0x91)), "without our mark");
    }

    #[test]
    fn acknack(reader in entity(), writer in entity(), state in set(), count: u32, last: bool) {
        let body = AckNack { reader, writer, state, count, final_flag: last };
        let bytes = written(|m| m.acknack(&body).unwrap());
        prop_assert!(matches!(read(&bytes), Submessage::AckNack(b) if b == body));
    }

    #[test]
    fn heartbeat(reader in entity(), writer in entity(), first in number(), more in 0..9i64,
                 count: u32, final_flag: bool, liveliness: bool) {
        let last = (first - 1 + more).min(MAX_SEQUENCE_NUMBER);
        let body = Heartbeat { reader, writer, first, last, count, final_flag, liveliness };
        let bytes = written(|m| m.heartbeat(&body).unwrap());
        prop_assert!(matches!(read(&bytes), Submessage::Heartbeat(b) if b == body));
    }

    #[test]
    fn gap(reader in entity(), writer in entity(), start in number(), list in set()) {
        let body = Gap { reader, writer, start, list };
        let bytes = written(|m| m.gap(&body).unwrap());
        prop_assert!(matches!(read(&bytes), Submessage::Gap(b) if b == body));
    }

    #[test]
    fn fragments_of_a_sample(reader in entity(), writer in entity(), sn in number(),
                             base in 1..9u32, bits in bits(), last: u32, count: u32) {
        let state = FragmentSet { base, bits };
        let nack = NackFrag { reader, writer, sn, state, count };
        let bytes = written(|m| m.nack_frag(&nack).unwrap());
        prop_assert!(matches!(read(&bytes), Submessage::NackFrag(b) if b == nack));
        let beat = HeartbeatFrag { reader, writer, sn, last, count };
        let bytes = written(|m| m.heartbeat_frag(&beat).unwrap());
        prop_assert!(matches!(read(&bytes), Submessage::HeartbeatFrag(b) if b == beat));
    }

    #[test]
    fn data(reader in entity(), writer in entity(), sn in number(),
            payload in prop::collection::vec(any::<u8>(), 0..50), key: bool) {
        let padded = payload.len().next_multiple_of(4);
        let payload = if key { Payload::Key(&payload) } else { Payload::Data(&payload) };
        let body = Data { reader, writer, sn, inline_qos: None, payload };
        let bytes = written(|m| m.data(&body, &[]).unwrap());
        let Submessage::Data(read) = read(&bytes) else { panic!() };
        prop_assert_eq!((read.reader, read.writer, read.sn), (reader, writer, sn));
        let (Payload::Key(got) | Payload::Data(got)) = read.payload else { panic!() };
        prop_assert_eq!(got.len(), padded);
    }

    #[test]
    fn data_frag(sn in number(), size in 1..60u16, start in 1..4u32, count in 1..4u16, cut in 0..3u32) {
        let sample_size = (start + u32::from(count) - 1) * u32::from(size) - cut.min(u32::from(size) - 1);
        let from = (start - 1) * u32::from(size);
        let payload = vec![1; (sample_size - from) as usize];
        let body = DataFrag {
            reader: EntityId::UNKNOWN, writer: EntityId::writer(1), sn, start, count,
            fragment_size: size, sample_size, key: false, inline_qos: None, payload: &payload,
        };
        let bytes = written(|m| m.data_frag(&body, &[]).unwrap());
        let Submessage::DataFrag(read) = read(&bytes) else { panic!() };
        prop_assert_eq!((read.start, read.count, read.sample_size), (start, count, sample_size));
        prop_assert_eq!(read.payload, &payload[..]);
    }

    #[test]
    fn infos(time in 0..4_000_000_000_000_000_000u64, prefix: [u8; 12]) {
        let bytes = written(|m| {
            m.info_timestamp(Some(Timestamp(time))).unwrap();
            m.info_timestamp(None).unwrap();
            m.info_source(GuidPrefix(prefix)).unwrap();
            m.info_destination(GuidPrefix(prefix)).unwrap();
            m.pad().unwrap();
        });
        let parts: Vec<_> = Message::decode(&bytes).unwrap().submessages().flatten().collect();
        let [
            Submessage::InfoTimestamp(Some(back)), Submessage::InfoTimestamp(None),
            Submessage::InfoSource(from), Submessage::InfoDestination(to), Submessage::Pad,
        ] = parts[..] else { panic!("{parts:?}") };
        prop_assert_eq!(back, Timestamp(time));
        prop_assert_eq!((from.0, to.0), (prefix, prefix));
    }

    /// A submessage that does not fit leaves the message whole, to the last byte of a full buffer:
    /// its length was once written over the last two bytes of a sample.
    #[test]
    fn short_buffers(room in 20..120usize) {
        let mut buf = vec![0; room];
        let mut m = MessageWriter::new(&mut buf, PREFIX).unwrap();
        while m.info_destination(PREFIX).is_ok() {}
        prop_assert_eq!(m.len(), 20 + (room - 20) / 16 * 16);
        let whole = |part| matches!(part, Ok(Submessage::InfoDestination(PREFIX)));
        prop_assert!(Message::decode(m.message()).unwrap().submessages().all(whole));
    }

    /// Neither panics nor reads forever, whatever the bytes.
    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let mut message = b"RTPS\x02\x03\x01\x0f............".to_vec();
        message.extend(&bytes);
        prop_assert!(Message::decode(&message).unwrap().submessages().count() <= bytes.len());
        let payload = [[0, 3, 0, 0].as_slice(), &bytes].concat();
        // An error, or a value whose text lies in the payload.
        prop_assert!(ParticipantData::decode(&payload).map_or(0, |data| data.name.len()) <= bytes.len());
        let names = EndpointData::decode(&payload).map_or(0, |data| data.partitions.count());
        prop_assert!(names <= bytes.len());
    }
}

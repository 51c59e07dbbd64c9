//! Bytes that genuine ROS 2 Kilted (Fast DDS 3.2) sent, byte by byte.

use replenish_rtps::wire::{
    CDR_LE, Data, Durability, Encapsulated, EndpointData, EntityId, Guid, GuidPrefix, INFINITE,
    Locators, Message, MessageWriter, ParticipantData, Payload, Qos, Reliability, Submessage,
    TypeHash, WireError, Writer, disposal, disposed_entity, is_disposal,
};

pub(crate) fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    let pair = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.chunks_exact(2).map(pair).collect()
}

/// Int32(7) on /chatter: header, `INFO_DST`, `INFO_TS`, DATA.
const INT32: &str = "52545053 0202 010f 010f7f013c07a86c00000000
    0e010c00 010f7f012b0772de00000000 09010800 dd1a036b 56fbffd5
    15051c00 0000 1000 00001204 00000603 00000000 01000000 00010000 07000000";

#[test]
fn a_sample_of_genuine_ros_2_is_read_as_it_was_meant() {
    let bytes = hex(INT32);
    let message = Message::decode(&bytes).unwrap();
    assert_eq!((message.version, message.vendor), ([2, 2], [1, 15]));
    assert_eq!(message.prefix.0[..], hex("010f7f013c07a86c00000000")[..]);
    let parts: Vec<_> = message.submessages().map(Result::unwrap).collect();
    let [
        Submessage::InfoDestination(to),
        Submessage::InfoTimestamp(Some(_)),
        Submessage::Data(data),
    ] = parts[..]
    else {
        panic!("{parts:?}");
    };
    assert_eq!(to.0[..], hex("010f7f012b0772de00000000")[..]);
    assert_eq!(data.reader, EntityId::reader(0x12));
    assert_eq!(data.writer, EntityId::writer(6));
    assert_eq!(data.sn, 1);
    let Payload::Data(payload) = data.payload else {
        panic!("{data:?}");
    };
    let payload = Encapsulated::decode(payload).unwrap();
    assert_eq!(payload.representation, 1);
    assert_eq!(payload.reader().u32(), Ok(7));
}

#[test]
fn the_same_sample_is_written_as_fast_dds_writes_it() {
    let theirs = hex(INT32);
    let mut buf = [0; 128];
    let mut m = MessageWriter::new(&mut buf, Message::decode(&theirs).unwrap().prefix).unwrap();
    m.info_destination(GuidPrefix(theirs[24..36].try_into().unwrap()))
        .unwrap();
    let time = Message::decode(&theirs).unwrap().submessages();
    let time = time.flatten().find_map(|part| match part {
        Submessage::InfoTimestamp(time) => time,
        _ => None,
    });
    m.info_timestamp(time).unwrap();
    let payload = [CDR_LE, 7u32.to_le_bytes()].concat();
    let data = Data {
        reader: EntityId::reader(0x12),
        writer: EntityId::writer(6),
        sn: 1,
        inline_qos: None,
        payload: Payload::Data(&payload),
    };
    m.data(&data, &[]).unwrap();
    // Version and vendor are our own; the fraction of the time may differ in its last bit.
    let ours = m.message();
    assert_eq!(ours.len(), theirs.len());
    assert_eq!(ours[8..44], theirs[8..44]);
    assert!(ours[44].abs_diff(theirs[44]) <= 4);
    assert_eq!(ours[45..], theirs[45..]);
}

#[test]
fn a_participant_comes_back_as_it_was_announced() {
    let prefix = GuidPrefix([9; 12]);
    let locators: Locators = ["127.0.0.1:7410", "[fe80::1]:7411"]
        .map(|addr| addr.parse().unwrap())
        .into_iter()
        .collect();
    let announced = ParticipantData {
        domain: Some(42),
        metatraffic_unicast: locators,
        default_unicast: locators,
        lease: 20_000_000_000,
        name: "/",
        user_data: b"enclave=/;",
        ..ParticipantData::new(prefix)
    };
    let mut buf = [0; 512];
    let mut w = Writer::new(&mut buf);
    announced.encode(&mut w);
    assert_eq!(ParticipantData::decode(w.finish().unwrap()), Ok(announced));
}

#[test]
fn a_type_hash_travels_in_user_data() {
    let hash = TypeHash(std::array::from_fn(|i| i as u8 * 7));
    let text = hash.user_data();
    assert!(text.starts_with(b"typehash=RIHS01_00070e15"));
    assert_eq!(TypeHash::find(&text), Some(hash));
    // Lyrical writes more keys to the same string.
    let more = [b"backend=cpu;".as_slice(), &text, b"x=1;"].concat();
    assert_eq!(TypeHash::find(&more), Some(hash));
    assert_eq!(TypeHash::find(b"typehash=RIHS01_00;"), None);
    assert_eq!(TypeHash::find(b"typehash=RIHS01_\xff\xff;"), None);
}

#[test]
fn an_endpoint_comes_back_as_it_was_announced() {
    let guid = Guid::new(GuidPrefix([3; 12]), EntityId::writer(6));
    let hash = TypeHash([0xab; 32]).user_data();
    let qos = Qos {
        deadline: 2_000_000_001,
        ..Qos::latched(3)
    };
    let mut announced = EndpointData::new(guid, "rt/chatter", "std_msgs::msg::dds_::Int32_", qos);
    announced.user_data = &hash;
    announced.max_size = Some(8);
    announced.unicast.add("10.0.0.1:7001".parse().unwrap());
    let mut buf = [0; 512];
    let mut w = Writer::new(&mut buf);
    announced.encode(&mut w);
    let read = EndpointData::decode(w.finish().unwrap()).unwrap();
    assert_eq!((read.guid, read.qos), (guid, qos));
    assert_eq!(
        (read.topic, read.type_name),
        ("rt/chatter", announced.type_name)
    );
    assert_eq!(read.user_data, hash);
    assert_eq!((read.max_size, read.unicast), (Some(8), announced.unicast));
    assert_eq!(read.partitions.count(), 0);
    assert_eq!(read.qos.durability, Durability::TransientLocal);
    assert_eq!(read.qos.lifespan, INFINITE);
}

/// RTPS 2.5, 9.6.4: a writer that names no reliability is reliable, a reader best effort.
#[test]
fn policies_that_are_not_named_have_the_defaults_of_their_kind() {
    let list = |entity: [u8; 4]| {
        let mut bytes = hex("00030000 5a001000 010f7f012b0772de00000000");
        bytes.extend(entity);
        bytes.extend(hex(
            "05000800 02000000 74000000 07000800 02000000 54000000 01000000",
        ));
        EndpointData::decode(&bytes).unwrap().qos.reliability
    };
    assert_eq!(list([0, 0, 6, 3]), Reliability::Reliable);
    assert_eq!(list([0, 0, 6, 4]), Reliability::BestEffort);
}

#[test]
fn an_endpoint_that_is_gone_is_named_by_key_or_hash() {
    let guid = Guid::new(GuidPrefix([3; 12]), EntityId::writer(6));
    let (mut qos, mut key) = ([0; 40], [0; 40]);
    let (qos, key) = disposal(guid, &mut qos, &mut key).unwrap();
    let mut buf = [0; 256];
    let mut m = MessageWriter::new(&mut buf, guid.prefix).unwrap();
    for payload in [Payload::Key(key), Payload::None] {
        let data = Data {
            reader: EntityId::UNKNOWN,
            writer: EntityId::SEDP_PUBLICATIONS_WRITER,
            sn: 2,
            inline_qos: None,
            payload,
        };
        m.data(&data, qos).unwrap();
    }
    let mut seen = 0;
    for part in Message::decode(m.message()).unwrap().submessages() {
        let Ok(Submessage::Data(data)) = part else {
            panic!("{part:?}");
        };
        assert!(is_disposal(data.inline_qos));
        let key = match data.payload {
            Payload::Key(key) => key,
            _ => &[],
        };
        assert_eq!(disposed_entity(key, data.inline_qos), Ok(guid));
        seen += 1;
    }
    assert_eq!(seen, 2);
}

#[test]
fn errors_name_the_field() {
    assert_eq!(Message::decode(b"RTPX").unwrap_err(), WireError::BadMagic);
    let bytes = hex("52545053 0302 010f 000000000000000000000000");
    assert_eq!(
        Message::decode(&bytes).unwrap_err(),
        WireError::BadVersion(3)
    );
    // A set of 257 bits; more than 256 do not exist.
    let text = "52545053 0202 010f 000000000000000000000000
        06011c00 00000000 00000000 00000000 01000000 01010000 00000000 00000000 00000000";
    let bytes = hex(text);
    let mut parts = Message::decode(&bytes).unwrap().submessages();
    let error = parts.next().unwrap().unwrap_err();
    assert_eq!(
        error.to_string(),
        "numBits (at most 256) is outside of its range"
    );
    assert!(
        parts.next().is_none(),
        "the rest of a damaged message is left"
    );
}

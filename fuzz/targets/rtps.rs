//! An RTPS message, its submessages, and the parameter lists of discovery in it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use replenish_rtps::wire::{
    EndpointData, Message, MessageWriter, ParticipantData, Payload, Submessage, TypeHash,
    disposed_entity, is_disposal,
};

fuzz_target!(|bytes: &[u8]| {
    let Ok(message) = Message::decode(bytes) else {
        return;
    };
    let mut buf = [0; 8192];
    for part in message.submessages().flatten() {
        let Ok(mut m) = MessageWriter::new(&mut buf, message.prefix) else {
            return;
        };
        // A submessage that was understood can be written, and is then understood in the same way.
        let written = match part {
            Submessage::AckNack(body) => m.acknack(&body),
            Submessage::Heartbeat(body) => m.heartbeat(&body),
            Submessage::Gap(body) => m.gap(&body),
            Submessage::NackFrag(body) => m.nack_frag(&body),
            Submessage::HeartbeatFrag(body) => m.heartbeat_frag(&body),
            Submessage::InfoTimestamp(time) => m.info_timestamp(time),
            Submessage::InfoSource(prefix) => m.info_source(prefix),
            Submessage::InfoDestination(prefix) => m.info_destination(prefix),
            Submessage::Data(body) => {
                let payload = match body.payload {
                    Payload::Data(payload) | Payload::Key(payload) => payload,
                    Payload::None => &[],
                };
                let _ = ParticipantData::decode(payload).map(|data| data.name.len());
                let _ = EndpointData::decode(payload)
                    .map(|data| (data.partitions.count(), TypeHash::find(data.user_data)));
                let _ = (
                    is_disposal(body.inline_qos),
                    disposed_entity(payload, body.inline_qos),
                );
                continue;
            }
            _ => continue,
        };
        assert_eq!(written, Ok(()));
        let mut again = Message::decode(m.message()).unwrap().submessages();
        assert!(matches!(again.next(), Some(Ok(_))) && again.next().is_none());
    }
});

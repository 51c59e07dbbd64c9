//! Every datagram of the capture is decoded, and encoding what was decoded gives its bytes again.

use crate::common::{assert_same, capture};
use replenish_xrce::wire::{Body, Info, Message, MessageWriter};

#[test]
fn every_captured_datagram_survives_decode_and_encode() {
    let mut kinds = std::collections::BTreeSet::new();
    for datagram in capture() {
        let message = Message::parse(&datagram.bytes).unwrap();
        let mut buf = [0; 2048];
        let mut writer = MessageWriter::new(&mut buf, &message.header).unwrap();
        let mut count = 0;
        for submessage in message.submessages() {
            let submessage = submessage.unwrap_or_else(|e| panic!("{datagram}: {e}"));
            let body = submessage
                .body()
                .unwrap_or_else(|e| panic!("{datagram}: {e}"));
            kinds.insert(format!("{:?}", submessage.id));
            // The client pads at the end of what it sends on streams, the agent does not.
            let padded = datagram.from_client && message.header.stream.0 != 0;
            let pushed = if padded {
                writer.push_padded(&body)
            } else {
                writer.push(&body)
            };
            pushed.unwrap_or_else(|e| panic!("{datagram}: {e}"));
            count += 1;
        }
        assert_eq!(count, datagram.annotations.len(), "{datagram}: submessages");
        assert_same(&datagram, writer.finish());
    }
    // Everything but RESET, which no implementation sends.
    assert_eq!(kinds.len(), 15, "{kinds:?}");
}

#[test]
fn the_agents_info_is_understood() {
    let infos: Vec<Info> = capture()
        .iter()
        .filter_map(|datagram| {
            let message = Message::parse(&datagram.bytes).unwrap();
            match message.submessages().next()?.unwrap().body().unwrap() {
                Body::Info(info) => Some(info),
                _ => None,
            }
        })
        .collect();
    assert!(!infos.is_empty());
    for info in infos {
        assert_eq!(info.availability, Some(1));
        assert_eq!(info.agent.unwrap().version, [1, 0]);
    }
}

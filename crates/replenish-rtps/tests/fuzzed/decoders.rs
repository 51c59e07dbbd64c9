//! Every decoder: a value or an error; a submessage that was understood can be written again.

use replenish_rtps::ros::{
    GidSize, KnownNodes, NodeLimits, Nodes, dds_topic, dds_type, ros_topic, ros_type,
};
use replenish_rtps::wire::{
    EndpointData, Message, MessageWriter, ParticipantData, Payload, Submessage, TypeHash,
    chain_origins, disposed_entity, is_disposal, related_request,
};
use std::hint::black_box;

pub(crate) const NODES: NodeLimits = NodeLimits {
    nodes: 8,
    of_one: 4,
    endpoints: 16,
};

/// A datagram through all of them. `known` is bounded by [`NODES`].
pub(crate) fn datagram(bytes: &[u8], known: &mut KnownNodes) {
    let Ok(message) = Message::decode(bytes) else {
        return;
    };
    let mut buf = [0; 1200];
    for part in message.submessages().flatten() {
        let mut m = MessageWriter::new(&mut buf, message.prefix).unwrap();
        // A submessage that was understood is written, and then understood in the same way.
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
                black_box((
                    is_disposal(body.inline_qos),
                    disposed_entity(payload, body.inline_qos).ok(),
                    related_request(body.inline_qos),
                    chain_origins(body.inline_qos),
                ));
                sample(payload);
                black_box(known.learn(message.prefix, payload)).ok();
                assert!(known.names().count() <= NODES.nodes);
                assert!(known.endpoints().count() <= NODES.endpoints);
                continue;
            }
            Submessage::DataFrag(body) => {
                black_box(related_request(body.inline_qos));
                continue;
            }
            Submessage::Shared(body) => m.shared(body.reader, body.writer, body.taken),
            Submessage::Reference(body) => {
                black_box((
                    related_request(body.inline_qos),
                    chain_origins(body.inline_qos),
                ));
                m.reference(&body, &[])
            }
            _ => continue,
        };
        assert_eq!(written, Ok(()));
        let mut again = Message::decode(m.message()).unwrap().submessages();
        assert!(matches!(again.next(), Some(Ok(_))) && again.next().is_none());
    }
}

/// A sample of discovery or of the graph, and the names in it.
pub(crate) fn sample(payload: &[u8]) {
    if let Ok(data) = ParticipantData::decode(payload) {
        assert!(data.name.len() <= payload.len());
    }
    if let Ok(data) = EndpointData::decode(payload) {
        assert!(data.partitions.count() <= payload.len());
        black_box(TypeHash::find(data.user_data));
        // The way back leads to the same name.
        if let Some((prefix, name)) = ros_topic(data.topic)
            && let Some(dds) = dds_topic(prefix, name)
        {
            assert_eq!(dds.as_str(), data.topic);
        }
        if let Some(ros) = ros_type(data.type_name)
            && let Some(dds) = dds_type(ros.as_str())
        {
            assert_eq!(dds.as_str(), data.type_name);
        }
    }
    for size in [GidSize::Bytes16, GidSize::Bytes24] {
        if let Ok((_, nodes)) = Nodes::decode(payload, size) {
            for node in nodes.flatten() {
                assert!(node.name.len() + node.namespace.len() <= payload.len());
            }
        }
    }
}

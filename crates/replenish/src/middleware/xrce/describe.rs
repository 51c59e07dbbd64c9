//! How the objects of a topic's endpoints are described to the agent, in bytes at once: the same as
//! with [`Entity`](replenish_xrce::wire::Entity), in a quarter of the code.

use crate::qos::{Durability, History, Qos, Reliability};
use core::time::Duration;
use replenish_xrce::wire::{
    CreationMode, Encode, ObjectId, ObjectKind, QOS_DURABILITY_TRANSIENT_LOCAL,
    QOS_HISTORY_KEEP_LAST, QOS_RELIABLE, Representation, RequestId, SubmessageId, Writer,
};

/// A participant, a topic, a publisher, a subscriber, a data writer or a data reader.
pub(super) struct Description<'a> {
    /// The described object; its kind gives the form.
    pub(super) object: ObjectId,
    /// The object that it belongs to; a participant's domain.
    pub(super) owner: [u8; 2],
    /// Of the node or of the topic, fully qualified.
    pub(super) name: &'a str,
    /// A topic's.
    pub(super) type_name: &'a str,
    /// A data writer's or reader's topic, and its QoS.
    pub(super) topic: ObjectId,
    pub(super) qos: &'a Qos,
}

impl Encode for Description<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::Create
    }

    fn flags(&self) -> u8 {
        CreationMode::REUSE_OR_REPLACE.flags()
    }

    fn write(&self, w: &mut Writer<'_>) {
        let [high, low] = RequestId::NONE.0.to_be_bytes();
        let [a, b] = self.object.to_bytes();
        w.put(&[high, low, a, b, self.kind(), Representation::<()>::BINARY]);
        w.nested(|w| self.binary(w));
        if self.is(ObjectKind::Participant) {
            w.align(2); // a number, not an id
        }
        w.put(&self.owner);
    }
}

/// A boolean: there is something, or not.
const NONE: u8 = 0;
const SOME: u8 = 1;

impl Description<'_> {
    /// The number of its kind.
    const fn kind(&self) -> u8 {
        let [_, low] = self.object.to_bytes();
        low & 0xf
    }

    const fn is(&self, kind: ObjectKind) -> bool {
        self.kind() == kind.number()
    }

    fn binary(&self, w: &mut Writer<'_>) {
        match ObjectKind::from_number(self.kind()) {
            Ok(ObjectKind::Participant) => {
                w.put(&[NONE, SOME]); // no reference, but a name
                w.string(self.name.get(1..).unwrap_or_default()); // after the slash
            }
            Ok(ObjectKind::Topic) => {
                // As ROS 2 names topics on DDS. What is checked has no NUL inside.
                let len = u32::try_from(self.name.len()).unwrap_or(u32::MAX);
                w.u32(len.saturating_add(3));
                w.put(b"rt");
                w.put(self.name.as_bytes());
                w.put(&[0, NONE, SOME]); // no reference, but a type
                w.string(self.type_name);
            }
            Ok(ObjectKind::Publisher | ObjectKind::Subscriber) => w.put(&[NONE, NONE]), // name, QoS
            _ => {
                let ([a, b], [c, d]) = (self.topic.to_bytes(), flags(self.qos).to_le_bytes());
                let [e, f] = self.qos.depth.to_le_bytes();
                w.put(&[a, b, SOME, 0, c, d, SOME, 0, e, f]); // with what aligns the numbers
                for time in [&self.qos.deadline, &self.qos.lifespan] {
                    w.option(time.map(|t| milliseconds(t, false).max(1)), Writer::u32);
                }
                // User data; a writer's strength, or a reader's time and content filters.
                let reads = self.is(ObjectKind::DataReader);
                w.put(if reads { &[NONE; 3] } else { &[NONE; 2] });
            }
        }
    }
}

fn flags(qos: &Qos) -> u16 {
    let flag = |set: bool, flag: u16| if set { flag } else { 0 };
    let local = qos.durability == Durability::TransientLocal;
    flag(qos.reliability == Reliability::Reliable, QOS_RELIABLE)
        | flag(qos.history == History::KeepLast, QOS_HISTORY_KEEP_LAST)
        | flag(local, QOS_DURABILITY_TRANSIENT_LOCAL)
}

/// A time in milliseconds; what is left of the last one counts as one, or not at all.
#[inline(never)]
pub(super) fn milliseconds(time: Duration, whole: bool) -> u32 {
    let seconds = u32::try_from(time.as_secs()).unwrap_or(u32::MAX);
    let rest = time.subsec_nanos() + if whole { 999_999 } else { 0 };
    let rest = rest / 1_000_000;
    seconds.saturating_mul(1000).saturating_add(rest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_xrce::wire::{
        BaseRequest, Create, DataReaderBinary, DataWriterBinary, EndpointQos, Entity, GroupBinary,
        ParticipantBinary, ReaderQos, TopicBinary, WriterQos,
    };

    fn bytes(body: &impl Encode) -> (u8, Vec<u8>) {
        let mut room = [0xee; 256];
        let mut w = Writer::new(&mut room);
        body.write(&mut w);
        let len = w.len();
        (body.flags(), room[..len].to_vec())
    }

    #[test]
    fn the_bytes_are_those_of_the_entity() {
        let timed = Qos::latched()
            .deadline(Duration::from_micros(500))
            .lifespan(Duration::from_millis(2500));
        let id = |kind| ObjectId::new(7, kind);
        let (participant, topic) = (id(ObjectKind::Participant), id(ObjectKind::Topic));
        for qos in [Qos::best_effort().keep_all(3), timed] {
            let times =
                [qos.deadline, qos.lifespan].map(|t| t.map(|t| milliseconds(t, false).max(1)));
            let endpoint = EndpointQos {
                flags: flags(&qos),
                depth: Some(qos.depth),
                deadline_ms: times[0],
                lifespan_ms: times[1],
                user_data: None,
            };
            let group = Representation::Binary(GroupBinary::default());
            let all = [
                Entity::Participant {
                    repr: Representation::Binary(ParticipantBinary {
                        domain_reference: None,
                        name: Some("ns/chatter"),
                    }),
                    domain: 0x0102,
                },
                Entity::Topic {
                    repr: Representation::Binary(TopicBinary {
                        name: "rt/ns/chatter",
                        type_reference: None,
                        type_name: Some("std_msgs::msg::dds_::Int32_"),
                    }),
                    participant,
                },
                Entity::Publisher {
                    repr: group,
                    participant,
                },
                Entity::Subscriber {
                    repr: group,
                    participant,
                },
                Entity::DataWriter {
                    repr: Representation::Binary(DataWriterBinary {
                        topic,
                        qos: Some(WriterQos {
                            endpoint,
                            ownership_strength: None,
                        }),
                    }),
                    publisher: id(ObjectKind::Publisher),
                },
                Entity::DataReader {
                    repr: Representation::Binary(DataReaderBinary {
                        topic,
                        qos: Some(ReaderQos {
                            endpoint,
                            ..ReaderQos::default()
                        }),
                    }),
                    subscriber: id(ObjectKind::Subscriber),
                },
            ];
            for entity in all {
                let owner = match entity {
                    Entity::Participant { .. } => [0x02, 0x01],
                    Entity::DataWriter { .. } => id(ObjectKind::Publisher).to_bytes(),
                    Entity::DataReader { .. } => id(ObjectKind::Subscriber).to_bytes(),
                    _ => participant.to_bytes(),
                };
                let (kind, object) = (entity.kind(), id(entity.kind()));
                let description = Description {
                    object,
                    owner,
                    name: "/ns/chatter",
                    type_name: "std_msgs::msg::dds_::Int32_",
                    topic,
                    qos: &qos,
                };
                let base = BaseRequest {
                    request: RequestId::NONE,
                    object,
                };
                let mode = CreationMode::REUSE_OR_REPLACE;
                let create = Create { base, mode, entity };
                assert_eq!(bytes(&description), bytes(&create), "{kind:?}");
            }
        }
    }
}

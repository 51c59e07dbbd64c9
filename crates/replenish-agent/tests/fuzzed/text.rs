//! XML and references, as clients and configurations give them.

use super::MS;
use super::agent::{Agent, login};
use replenish_agent::{AgentConfig, AgentCore, Now, Profiles};
use replenish_xrce::wire::{
    BaseRequest, Create, CreationMode, Encode, Entity, MessageWriter, ObjectId, ObjectKind,
    Representation, RequestId,
};

/// As a configuration's profiles, and as the description of every kind of entity.
pub(crate) fn everywhere(text: &str) {
    let profiles = Profiles::parse(text).unwrap_or_default();
    if text.contains('\0') || text.len() > 3000 {
        return; // cannot be sent
    }
    let mut agent = AgentCore::with(&AgentConfig {
        limits: super::agent::LIMITS,
        profiles,
        ..AgentConfig::default()
    });
    let now = |at| Now {
        monotonic: at,
        unix: 0,
    };
    agent.receive(now(0), 0_u8, &login(0, 0x81));
    let mut seq = 0;
    for is_xml in [true, false] {
        for entity in entities(is_xml, text) {
            let object = ObjectId::new(1, entity.kind());
            let create = Create {
                base: BaseRequest {
                    request: RequestId(10),
                    object,
                },
                mode: CreationMode::default(),
                entity,
            };
            agent.receive(now(MS), 0, &on_stream(seq, &create));
            seq += 1;
            let mut sent = 0;
            while agent.pump(now(MS), 16, &mut |_, _| sent += 1) {
                assert!(sent < 100, "no end");
            }
        }
    }
    assert!(agent.snapshot(now(MS)).queued_bytes <= super::agent::LIMITS.memory());
}

fn on_stream(seq: u16, body: &impl Encode) -> Vec<u8> {
    let mut buf = vec![0; 4096];
    let header = Agent::header(0x81, 0x01, seq);
    let mut message = MessageWriter::new(&mut buf, &header).unwrap();
    message.push(body).unwrap();
    message.finish().to_vec()
}

/// The text as whichever representation is asked for.
fn form<'a, B>(is_xml: bool, text: &'a str) -> Representation<'a, B> {
    if is_xml {
        Representation::Xml(text)
    } else {
        Representation::Reference(text)
    }
}

fn entities(is_xml: bool, text: &str) -> [Entity<'_>; 8] {
    let id = |kind| ObjectId::new(1, kind);
    let participant = id(ObjectKind::Participant);
    let (publisher, subscriber) = (id(ObjectKind::Publisher), id(ObjectKind::Subscriber));
    [
        Entity::Participant {
            repr: form(is_xml, text),
            domain: 0,
        },
        Entity::Topic {
            repr: form(is_xml, text),
            participant,
        },
        Entity::Publisher {
            repr: form(is_xml, text),
            participant,
        },
        Entity::Subscriber {
            repr: form(is_xml, text),
            participant,
        },
        Entity::DataWriter {
            repr: form(is_xml, text),
            publisher,
        },
        Entity::DataReader {
            repr: form(is_xml, text),
            subscriber,
        },
        Entity::Requester {
            repr: form(is_xml, text),
            participant,
        },
        Entity::Replier {
            repr: form(is_xml, text),
            participant,
        },
    ]
}

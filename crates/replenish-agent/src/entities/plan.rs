//! What a CREATE asks for, however the client says it.

use super::qos::Qos;
use super::topics::TopicKey;

/// What a CREATE asks for. Two that are equal describe the same entity, however they say it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Plan {
    Participant { domain: i16, name: Box<str> },
    Topic { key: TopicKey },
    Group { domain: i16 },
    Writer { key: TopicKey, qos: Qos },
    Reader { key: TopicKey, qos: Qos },
    Requester { request: TopicKey, reply: TopicKey },
    Replier { request: TopicKey, reply: TopicKey },
}

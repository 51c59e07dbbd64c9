//! The entity that a CREATE describes, in whatever form.

use super::qos::Qos;
use super::topics::TopicKey;

/// The entity that a CREATE describes. Equal plans describe the same entity, whatever the form.
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

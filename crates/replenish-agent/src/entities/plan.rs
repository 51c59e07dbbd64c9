//! The entity that a CREATE describes, in whatever form.

use super::qos::Qos;
use super::topics::TopicKey;
use replenish_xrce::wire::Status;
use std::sync::Arc;

/// The entity that a CREATE describes. Equal plans describe the same entity, whatever the form.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Plan {
    Participant { domain: i16, name: Arc<str> },
    Topic { key: TopicKey },
    Group { domain: i16 },
    Writer { key: TopicKey, qos: Qos },
    Reader { key: TopicKey, qos: Qos },
    Requester { request: TopicKey, reply: TopicKey },
    Replier { request: TopicKey, reply: TopicKey },
}

/// The longest name of a topic, type or participant, in bytes: that of DDS and of ROS 2.
pub(crate) const MAX_NAME: usize = 255;

impl Plan {
    /// All names in it.
    fn names(&self) -> impl Iterator<Item = &Arc<str>> {
        let (first, second, node) = match self {
            Self::Participant { name, .. } => (None, None, Some(name)),
            Self::Group { .. } => (None, None, None),
            Self::Topic { key } | Self::Writer { key, .. } | Self::Reader { key, .. } => {
                (Some(key), None, None)
            }
            Self::Requester { request, reply } | Self::Replier { request, reply } => {
                (Some(request), Some(reply), None)
            }
        };
        let keys = first.into_iter().chain(second);
        let of_keys = keys.flat_map(|key| [&key.name, &key.type_name]);
        of_keys.chain(node)
    }

    /// Bytes of all names in it.
    pub(crate) fn name_bytes(&self) -> usize {
        self.names().map(|name| name.len()).sum()
    }

    /// The status that refuses a name which is too long, or cannot be shown.
    pub(crate) fn check_names(&self) -> Result<(), Status> {
        if self.names().any(|name| name.len() > MAX_NAME) {
            return Err(Status::RESOURCES);
        }
        if self.names().any(|name| name.chars().any(char::is_control)) {
            return Err(Status::INVALID_DATA);
        }
        Ok(())
    }

    /// The topic, or that of a service's requests, and its type; a participant's name has none.
    pub(crate) fn subject(&self) -> Option<(Arc<str>, Option<Arc<str>>)> {
        match self {
            Self::Group { .. } => None,
            Self::Participant { name, .. } => Some((name.clone(), None)),
            Self::Topic { key } | Self::Writer { key, .. } | Self::Reader { key, .. } => {
                Some((key.name.clone(), Some(key.type_name.clone())))
            }
            Self::Requester { request, .. } | Self::Replier { request, .. } => {
                Some((request.name.clone(), Some(request.type_name.clone())))
            }
        }
    }
}

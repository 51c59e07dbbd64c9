//! Messages that an agent sends unasked: an endpoint does not talk with others because of its QoS;
//! a requester's service has a server, or has none.
//!
//! DDS-XRCE has no message for it. Agents of replenish send a STATUS of request 0, which answers
//! nothing, on the reliable stream 0, and put the detail into the field that the standard leaves to
//! implementations. They do so to clients that have asked for [`DELIVERY`](super::DELIVERY), and to
//! no others.

use super::{BaseRequest, ObjectId, RequestId, Status, StatusReply};

/// A notice of the agent about one of the client's objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Notice {
    /// A data writer offers less than a reader of its topic asks for, or a data reader asks for
    /// more than a writer offers. The policies as bits: [`Notice::RELIABILITY`],
    /// [`Notice::DURABILITY`], [`Notice::DEADLINE`].
    IncompatibleQos(u8),
    /// Whether the service of a requester has a server.
    Served(bool),
}

impl Notice {
    /// Best effort is offered, reliable is requested.
    pub const RELIABILITY: u8 = 1;
    /// Less durability is offered than is requested.
    pub const DURABILITY: u8 = 2;
    /// A longer deadline is offered, or none, than is requested.
    pub const DEADLINE: u8 = 4;

    /// The message that says this about `object`.
    #[must_use]
    pub const fn about(self, object: ObjectId) -> StatusReply {
        let (status, implementation) = match self {
            Self::IncompatibleQos(policies) => (Status::INCOMPATIBLE, policies),
            Self::Served(served) => (Status::OK, served as u8),
        };
        StatusReply {
            base: BaseRequest {
                request: RequestId::NONE,
                object,
            },
            status,
            implementation,
        }
    }

    /// The notice that `status` carries, if it is one.
    #[must_use]
    pub fn of(status: &StatusReply) -> Option<Self> {
        if status.base.request != RequestId::NONE {
            return None;
        }
        match status.status {
            Status::INCOMPATIBLE => Some(Self::IncompatibleQos(status.implementation)),
            Status::OK => Some(Self::Served(status.implementation != 0)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::ObjectKind;

    #[test]
    fn what_is_said_is_understood_and_answers_are_no_notices() {
        let object = ObjectId::new(3, ObjectKind::Requester);
        let said = [
            Notice::IncompatibleQos(Notice::RELIABILITY | Notice::DEADLINE),
            Notice::Served(true),
            Notice::Served(false),
        ];
        for notice in said {
            let message = notice.about(object);
            assert_eq!(message.base.object, object);
            assert_eq!(Notice::of(&message), Some(notice));
            let mut answer = message;
            answer.base.request = RequestId::FIRST;
            assert_eq!(Notice::of(&answer), None);
        }
    }
}

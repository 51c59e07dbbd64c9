//! The nodes and endpoints that a program opens in DDS, and their samples.

use super::qos::Qos;

/// Identifies an endpoint or node. The program chooses it and uses it once.
pub type Id = u64;

/// A DDS topic as ROS 2 names it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topic {
    /// `rt/chatter`, `rq/addRequest`, `rr/addReply`.
    pub name: String,
    /// `std_msgs::msg::dds_::String_`.
    pub type_name: String,
}

impl Topic {
    /// A topic.
    pub fn new(name: impl Into<String>, type_name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            type_name: type_name.into(),
        }
    }
}

/// A ROS 2 node, which ROS 2's tools list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Node {
    /// 0 to [`MAX_DOMAIN`](super::MAX_DOMAIN).
    pub domain: u16,
    /// `name` or `name/space/name`, with or without a slash before it.
    pub name: String,
}

/// Something that sends or receives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// 0 to [`MAX_DOMAIN`](super::MAX_DOMAIN).
    pub domain: u16,
    /// The node it belongs to, if any.
    pub node: Option<Id>,
    /// Its kind.
    pub kind: EndpointKind,
}

/// The kind of an endpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EndpointKind {
    /// Publishes.
    Writer {
        /// The published topic.
        topic: Topic,
        /// The offered QoS.
        qos: Qos,
    },
    /// Subscribes.
    Reader {
        /// The subscribed topic.
        topic: Topic,
        /// The requested QoS.
        qos: Qos,
    },
    /// Calls a service.
    Requester {
        /// Where requests go.
        request: Topic,
        /// Where replies come from.
        reply: Topic,
    },
    /// Offers a service.
    Replier {
        /// Where requests come from.
        request: Topic,
        /// Where replies go.
        reply: Topic,
    },
}

impl EndpointKind {
    /// The topic that it is listed with: that of the requests for a service.
    #[must_use]
    pub fn topic(&self) -> &Topic {
        match self {
            Self::Writer { topic, .. } | Self::Reader { topic, .. } => topic,
            Self::Requester { request, .. } | Self::Replier { request, .. } => request,
        }
    }
}

/// The request: at a requester whatever the program says, at a replier what it got with the
/// request and gives back with the reply. Laid out like DDS-RPC's `SampleIdentity`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RequestId {
    /// The GUID of its writer.
    pub guid: [u8; 16],
    /// Its number.
    pub sequence: i64,
}

/// A sample for DDS.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outgoing {
    /// Little-endian XCDR1 without encapsulation header.
    pub payload: Vec<u8>,
    /// At a requester the name of the request, at a replier the request that this answers.
    pub request: Option<RequestId>,
}

impl Outgoing {
    /// A sample of a writer.
    #[must_use]
    pub fn sample(payload: Vec<u8>) -> Self {
        Self {
            payload,
            request: None,
        }
    }

    /// A request or reply.
    #[must_use]
    pub fn call(request: RequestId, payload: Vec<u8>) -> Self {
        Self {
            payload,
            request: Some(request),
        }
    }
}

/// A sample from DDS.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Incoming {
    /// Little-endian XCDR1 without encapsulation header.
    pub payload: Vec<u8>,
    /// At a requester the name of the request that this answers, at a replier the request.
    pub request: Option<RequestId>,
}

//! A reader or writer to be made, as the participant wants it described.

use super::qos::{ENCAPSULATION, PADDING, dds, type_hash};
use crate::middleware::{EndpointSpec, MiddlewareError};
use crate::platform::label;
use crate::qos::{IngressLimit, Qos};
use replenish_rtps::participant as rtps;
use replenish_rtps::ros::Prefix;
use std::io;

/// A reader or writer to be made.
pub(super) struct NewEnd<'a> {
    pub(super) node: &'a str,
    /// The full name in ROS.
    pub(super) name: &'a str,
    pub(super) prefix: Prefix,
    /// The type in DDS.
    pub(super) ty: &'a str,
    pub(super) type_hash: Option<&'a str>,
    pub(super) qos: Qos,
    pub(super) max_size: usize,
    /// Bytes that may stand between encapsulation and sample.
    pub(super) head: usize,
    pub(super) keep_oldest: bool,
}

impl<'a> NewEnd<'a> {
    /// That of a topic.
    pub(super) fn topic(spec: &EndpointSpec<'a>) -> Result<Self, MiddlewareError> {
        if spec.ingress != IngressLimit::none() {
            let what = label("limits on what peers send (the socket of each reader is one)");
            return Err(MiddlewareError::Unsupported(what));
        }
        Ok(Self {
            node: spec.node,
            name: spec.topic,
            prefix: Prefix::Topic,
            ty: spec.dds_type_name,
            type_hash: spec.type_hash,
            qos: spec.qos,
            max_size: spec.max_size,
            head: 0,
            keep_oldest: spec.keep_oldest,
        })
    }

    /// Bytes of the longest sample with its encapsulation.
    pub(super) const fn bytes(&self) -> usize {
        let more = self.head.saturating_add(ENCAPSULATION + PADDING);
        self.max_size.saturating_add(more)
    }

    pub(super) fn spec<'s>(&'s self, topic: &'s str, samples: usize) -> rtps::EndpointSpec<'s> {
        rtps::EndpointSpec {
            type_hash: type_hash(self.type_hash),
            qos: dds(self.qos, self.keep_oldest),
            sample_bytes: self.bytes(),
            samples,
            ..rtps::EndpointSpec::new(topic, self.ty)
        }
    }
}

pub(super) fn failed(what: &'static str, error: &io::Error) -> MiddlewareError {
    MiddlewareError::Io {
        what: label(what),
        errno: error.raw_os_error().unwrap_or(0),
    }
}

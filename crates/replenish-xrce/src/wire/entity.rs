//! Binary representations of participants, topics, publishers, subscribers, requesters, repliers.

use super::{Reader, WireError, Writer};

/// A participant (`OBJK_DomainParticipant_Binary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ParticipantBinary<'a> {
    /// A domain's name in the agent's configuration.
    pub domain_reference: Option<&'a str>,
    /// A QoS profile's name; micro-ROS puts the node's name here.
    pub name: Option<&'a str>,
}

impl<'a> ParticipantBinary<'a> {
    pub(super) fn write(&self, w: &mut Writer<'_>) {
        w.option(self.domain_reference, Writer::string);
        w.option(self.name, Writer::string);
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        Ok(ParticipantBinary {
            domain_reference: r.option(Reader::string)?,
            name: r.option(Reader::string)?,
        })
    }
}

/// A topic (`OBJK_Topic_Binary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicBinary<'a> {
    /// The DDS topic name, for ROS with its prefix: `rt/chatter`.
    pub name: &'a str,
    /// A type's name in the agent's configuration.
    pub type_reference: Option<&'a str>,
    /// The DDS type name: `std_msgs::msg::dds_::Int32_`.
    pub type_name: Option<&'a str>,
}

impl<'a> TopicBinary<'a> {
    pub(super) fn write(&self, w: &mut Writer<'_>) {
        w.string(self.name);
        w.option(self.type_reference, Writer::string);
        w.option(self.type_name, Writer::string);
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        Ok(TopicBinary {
            name: r.string()?,
            type_reference: r.option(Reader::string)?,
            type_name: r.option(Reader::string)?,
        })
    }
}

/// A publisher or subscriber (`OBJK_Publisher_Binary`, `OBJK_Subscriber_Binary`). Their QoS
/// (partitions, group data) is sent by no client; it is skipped when decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct GroupBinary<'a> {
    /// Its name.
    pub name: Option<&'a str>,
}

impl<'a> GroupBinary<'a> {
    pub(super) fn write(&self, w: &mut Writer<'_>) {
        w.option(self.name, Writer::string);
        w.bool(false);
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        let name = r.option(Reader::string)?;
        r.option(|r| {
            r.option(|r| {
                let partitions = r.u32()?;
                for _ in 0..partitions {
                    r.string()?;
                }
                Ok(())
            })?;
            r.option(Reader::bytes)
        })?;
        Ok(GroupBinary { name })
    }
}

/// A requester or replier (`OBJK_Requester_Binary`, `OBJK_Replier_Binary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceBinary<'a> {
    /// The service's name.
    pub service: &'a str,
    /// The DDS type of requests.
    pub request_type: &'a str,
    /// The DDS type of replies.
    pub reply_type: &'a str,
    /// The topic of requests: `rq/addRequest`.
    pub request_topic: Option<&'a str>,
    /// The topic of replies: `rr/addReply`.
    pub reply_topic: Option<&'a str>,
}

impl<'a> ServiceBinary<'a> {
    pub(super) fn write(&self, w: &mut Writer<'_>) {
        w.string(self.service);
        w.string(self.request_type);
        w.string(self.reply_type);
        w.option(self.request_topic, Writer::string);
        w.option(self.reply_topic, Writer::string);
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        Ok(ServiceBinary {
            service: r.string()?,
            request_type: r.string()?,
            reply_type: r.string()?,
            request_topic: r.option(Reader::string)?,
            reply_topic: r.option(Reader::string)?,
        })
    }
}

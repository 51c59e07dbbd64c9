//! Participants and endpoints of other processes, as their announcements describe them.

use crate::wire::{
    EndpointData, Guid, GuidPrefix, INFINITE, Locators, Nanos, ParticipantData, Qos, Reach,
    SegmentName, SequenceNumber, TypeHash,
};
use core::net::{Ipv4Addr, SocketAddr};

/// A participant of another process.
#[derive(Clone, Copy, Debug)]
pub struct RemoteParticipant {
    /// Its name.
    pub prefix: GuidPrefix,
    /// Its vendor: 01.0f eProsima, 01.10 Eclipse Cyclone, 01.12 RustDDS.
    pub vendor: [u8; 2],
    /// Where its discovery is reached.
    pub(super) discovery: SocketAddr,
    /// Where its other endpoints are reached, unless they say another address.
    pub(super) user: SocketAddr,
    pub(super) lease: Nanos,
    pub(super) expires: Nanos,
    /// The highest number of its announcements.
    pub(super) announced: SequenceNumber,
    /// An endpoint of it found the bound of endpoints reached.
    pub(super) refused: bool,
    /// It is to be answered with an announcement of ours.
    pub(super) answer: bool,
    /// Goodbyes that it is still to get before it is met anew.
    pub(super) goodbyes: u8,
    /// It got the last one, and its next announcement is as its first.
    pub(super) anew: bool,
    /// When it has acknowledged nothing by then, it got none of them.
    pub(super) doubted_at: Nanos,
}

impl RemoteParticipant {
    /// `None` without an address that can be sent to.
    pub(super) fn new(
        data: &ParticipantData<'_>,
        announced: SequenceNumber,
        own: (Reach, &Locators),
        now: Nanos,
    ) -> Option<Self> {
        let (discovery, user) = addresses(data, own)?;
        Some(RemoteParticipant {
            prefix: data.prefix,
            vendor: data.vendor,
            discovery,
            user,
            lease: data.lease,
            expires: now.saturating_add(data.lease),
            announced,
            refused: false,
            answer: true,
            goodbyes: 0,
            anew: false,
            doubted_at: INFINITE,
        })
    }
}

/// Where discovery and the other endpoints of a participant are sent to; `None` without an address
/// within reach of our own.
pub(super) fn addresses(
    data: &ParticipantData<'_>,
    (reach, own): (Reach, &Locators),
) -> Option<(SocketAddr, SocketAddr)> {
    let discovery = data.metatraffic_unicast.best(reach, own)?;
    let user = data.default_unicast.best(reach, own);
    Some((discovery, user.unwrap_or(discovery)))
}

/// A text of at most 255 bytes, as long as a topic's name in ROS 2 may be.
#[derive(Clone, Copy)]
pub(super) struct Text {
    len: u8,
    bytes: [u8; 255],
}

impl Text {
    pub(super) fn new(text: &str) -> Option<Self> {
        let mut bytes = [0; 255];
        bytes
            .get_mut(..text.len())?
            .copy_from_slice(text.as_bytes());
        let len = u8::try_from(text.len()).ok()?;
        Some(Text { len, bytes })
    }

    fn bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }

    pub(super) fn as_str(&self) -> &str {
        core::str::from_utf8(self.bytes()).unwrap_or("")
    }
}

impl PartialEq for Text {
    fn eq(&self, other: &Self) -> bool {
        self.len == other.len && self.bytes() == other.bytes()
    }
}

impl core::fmt::Debug for Text {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.as_str().fmt(f)
    }
}

/// An endpoint of another process.
#[derive(Clone, Copy, Debug)]
pub struct RemoteEndpoint {
    /// Its name.
    pub guid: Guid,
    /// Its quality of service.
    pub qos: Qos,
    /// The hash of its type, if it announces one.
    pub type_hash: Option<TypeHash>,
    pub(super) topic: Text,
    pub(super) type_name: Text,
    /// Whether the default partition is among its partitions.
    pub(super) default_partition: bool,
    /// Where it is reached; set by whoever knows its participant.
    pub(super) to: SocketAddr,
    /// The memory that it shares.
    pub(super) segment: Option<SegmentName>,
}

impl RemoteEndpoint {
    /// `None` if a name is longer than 255 bytes.
    pub(super) fn new(data: &EndpointData<'_>) -> Option<Self> {
        let mut named = data.partitions;
        let default = |name: &str| name.is_empty() || name == "*";
        Some(RemoteEndpoint {
            guid: data.guid,
            qos: data.qos,
            type_hash: TypeHash::find(data.user_data),
            topic: Text::new(data.topic)?,
            type_name: Text::new(data.type_name)?,
            default_partition: data.partitions.clone().next().is_none() || named.any(default),
            to: SocketAddr::new(Ipv4Addr::UNSPECIFIED.into(), 0),
            segment: data.segment,
        })
    }

    /// Whether both fit the same own endpoints.
    pub(super) fn fits_as(&self, other: &Self) -> bool {
        self.qos == other.qos
            && self.topic == other.topic
            && self.type_name == other.type_name
            && self.default_partition == other.default_partition
    }

    /// Its topic, in ROS 2 with its prefix.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.topic.as_str()
    }

    /// Its type's name.
    #[must_use]
    pub fn type_name(&self) -> &str {
        self.type_name.as_str()
    }
}

//! The settings of a participant and its bounds on memory.

use crate::wire::{GuidPrefix, Locators, Nanos, Qos, SegmentName, TypeHash};
use core::fmt;
use core::net::SocketAddr;

/// Bounds; their memory is taken at set-up.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Other participants, 1 to 1000.
    pub participants: usize,
    /// Endpoints of other participants, 1 to 65 536. About 700 bytes each.
    pub endpoints: usize,
    /// Own writers and own readers, 1 to 10 000 each.
    pub own_endpoints: usize,
    /// Peers of one own endpoint, 1 to 1000.
    pub matches: usize,
    /// Events that were not taken, 16 to 65 536.
    pub events: usize,
}

impl Default for Limits {
    /// 32 participants with 512 endpoints, 64 own writers and readers with 32 peers each.
    fn default() -> Self {
        Limits {
            participants: 32,
            endpoints: 512,
            own_endpoints: 64,
            matches: 32,
            events: 256,
        }
    }
}

/// A participant's settings.
#[derive(Clone, Copy, Debug)]
pub struct ParticipantConfig<'a> {
    /// Its name, unlike that of any other. One that is started anew may have the name of before:
    /// peers notice it at its first announcement, if that of before had sent more than nine, which
    /// takes some 12 s, and otherwise after its lease.
    pub prefix: GuidPrefix,
    /// The domain, 0 to 232.
    pub domain: u32,
    /// Where its discovery is reached.
    pub discovery: Locators,
    /// Where its readers and writers are reached.
    pub user: Locators,
    /// Where announcements go besides to those who are known: a multicast group, static peers.
    pub announce_to: &'a [SocketAddr],
    /// How long it counts as alive after an announcement; 1 s to 1 h.
    pub lease: Nanos,
    /// Its name in words.
    pub name: &'a str,
    /// Its enclave, in ROS 2 `/`.
    pub enclave: &'a str,
    /// Bytes of a datagram to other hosts, 1200 to 65 000. Longer samples are cut into fragments.
    pub datagram: usize,
    /// The same for samples whose readers are all on this host, 1200 to 65 000.
    pub host_datagram: usize,
    /// Bytes of fragments that are sent to readers on this host at once, from 1200: no more than
    /// their sockets keep.
    pub host_burst: usize,
    /// Announcements of endpoints that wait until they are read, or for an earlier one, 1 to 64.
    /// Two buffers of as many are taken.
    pub announcements: usize,
    /// Bytes of the longest announcement of an endpoint that is taken, 512 to 65 000.
    pub announcement_bytes: usize,
    /// Whether endpoints are kept of whose topics there is no own endpoint yet. Without them, the
    /// own endpoints must be made before others are heard, and `limits.endpoints` can be small.
    pub whole_graph: bool,
    /// Bounds.
    pub limits: Limits,
}

/// The lease that ROS 2 participants have, in nanoseconds.
pub const DEFAULT_LEASE: Nanos = 20_000_000_000;

impl ParticipantConfig<'_> {
    /// A participant of domain 0 without addresses, that is announced for 20 s.
    #[must_use]
    pub fn new(prefix: GuidPrefix) -> Self {
        ParticipantConfig {
            prefix,
            domain: 0,
            discovery: Locators::NONE,
            user: Locators::NONE,
            announce_to: &[],
            lease: DEFAULT_LEASE,
            name: "/",
            enclave: "/",
            datagram: 1472,
            host_datagram: 1472,
            host_burst: 128_000,
            announcements: 16,
            announcement_bytes: 8192,
            whole_graph: true,
            limits: Limits::default(),
        }
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let limits = &self.limits;
        let second = 1_000_000_000;
        let fields = [
            ("domain", u64::from(self.domain), 0, 232),
            ("lease", self.lease, second, 3600 * second),
            ("datagram", self.datagram as u64, 1200, 65_000),
            ("host_datagram", self.host_datagram as u64, 1200, 65_000),
            ("host_burst", self.host_burst as u64, 1200, u64::MAX),
            ("announcements", self.announcements as u64, 1, 64),
            (
                "announcement_bytes",
                self.announcement_bytes as u64,
                512,
                65_000,
            ),
            ("name", self.name.len() as u64, 0, 128),
            ("enclave", self.enclave.len() as u64, 0, 128),
            ("limits.participants", limits.participants as u64, 1, 1000),
            ("limits.endpoints", limits.endpoints as u64, 1, 65_536),
            (
                "limits.own_endpoints",
                limits.own_endpoints as u64,
                1,
                10_000,
            ),
            ("limits.matches", limits.matches as u64, 1, 1000),
            ("limits.events", limits.events as u64, 16, 65_536),
        ];
        let out = |(_, value, least, most): &(&str, u64, u64, u64)| value < least || value > most;
        match fields.into_iter().find(out) {
            None => Ok(()),
            Some((field, value, least, most)) => Err(ConfigError::Range {
                field,
                value,
                least,
                most,
            }),
        }
    }
}

/// A writer or reader to be made.
#[derive(Clone, Copy, Debug)]
pub struct EndpointSpec<'a> {
    /// The topic, 1 to 255 bytes; in ROS 2 with its prefix (`rt/chatter`).
    pub topic: &'a str,
    /// The type's name, 1 to 255 bytes (`std_msgs::msg::dds_::Int32_`).
    pub type_name: &'a str,
    /// The hash of the type.
    pub type_hash: Option<TypeHash>,
    /// Quality of service.
    pub qos: Qos,
    /// Bytes of the longest sample with its encapsulation, 4 to 512 MiB.
    pub sample_bytes: usize,
    /// Samples that are kept, 1 to 65 536; at least the quality of service's depth is taken.
    pub samples: usize,
    /// Where a reader is reached; nothing: at the participant's address.
    pub unicast: Locators,
    /// Bytes of all samples of a writer together, see
    /// [`WriterLimits::memory`](crate::endpoint::WriterLimits::memory).
    pub memory: Option<usize>,
    /// It is the participant's own, as discovery is, and has a counterpart in every other one: it
    /// is matched with as many as there are participants, with none of its own participant, and a
    /// reader is reached where discovery is.
    pub per_participant: bool,
    /// Memory that a writer shares with programs on its host: readers that can fetch samples from
    /// it get a reference to each that has a place there, see
    /// [`Header::shared`](crate::endpoint::Header::shared).
    pub segment: Option<SegmentName>,
}

impl<'a> EndpointSpec<'a> {
    /// An endpoint with ROS 2's default quality of service and samples of at most 1 kB.
    #[must_use]
    pub const fn new(topic: &'a str, type_name: &'a str) -> Self {
        EndpointSpec {
            topic,
            type_name,
            type_hash: None,
            qos: Qos::ros(),
            sample_bytes: 1024,
            samples: 1,
            unicast: Locators::NONE,
            memory: None,
            per_participant: false,
            segment: None,
        }
    }

    pub(super) fn check(&self) -> Result<usize, ConfigError> {
        let depth = usize::try_from(self.qos.depth).unwrap_or(usize::MAX);
        let samples = self.samples.max(depth);
        let fields = [
            ("topic", self.topic.len(), 1, 255),
            ("type_name", self.type_name.len(), 1, 255),
            ("sample_bytes", self.sample_bytes, 4, 512 << 20),
            ("samples", samples, 1, 65_536),
        ];
        for (field, value, least, most) in fields {
            if value < least || value > most {
                return Err(ConfigError::Range {
                    field,
                    value: value as u64,
                    least: least as u64,
                    most: most as u64,
                });
            }
        }
        Ok(samples)
    }
}

/// Why a participant or an endpoint was not made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ConfigError {
    /// A field is outside of its range. Texts count their bytes.
    Range {
        /// The field.
        field: &'static str,
        /// Its value.
        value: u64,
        /// The least value.
        least: u64,
        /// The greatest value.
        most: u64,
    },
    /// There are as many writers or readers as `limits.own_endpoints` allows.
    Full,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ConfigError::Range {
                field,
                value,
                least,
                most,
            } => write!(f, "{field} = {value} is not allowed: {least} to {most}"),
            ConfigError::Full => f.write_str("limits.own_endpoints is reached"),
        }
    }
}

impl core::error::Error for ConfigError {}

//! Where and as whom to take part in a domain, and why that failed.

use crate::error::Error;
use crate::platform::text;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;
use replenish_rtps::participant::{DEFAULT_LEASE, Limits};
use replenish_rtps::udp::{HOST_DATAGRAM, OpenError};
use std::io;
use std::net::Ipv4Addr;

/// The participants that are looked for without being named (`ROS_AUTOMATIC_DISCOVERY_RANGE`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DiscoveryRange {
    /// Nobody. Nodes of one context hear each other all the same.
    Off,
    /// Programs on this host. Others that name this host as a static peer are answered; with
    /// [`RtpsConfig::interfaces`] of loopback alone nobody else is.
    Localhost,
    /// All programs that multicast reaches.
    #[default]
    Subnet,
}

/// The versions of IP that a participant speaks. ROS 2 has no variable for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IpVersions {
    /// IPv4, as ROS 2 does. IPv6 besides, if a static peer has no other address.
    #[default]
    V4,
    /// IPv6 alone.
    V6,
    /// Both. A peer that has both is sent to by IPv4. With [`DiscoveryRange::Localhost`] IPv4
    /// alone.
    Both,
}

/// The settings of a participant.
///
/// ```
/// use replenish::middleware::rtps::{DiscoveryRange, RtpsConfig};
/// let config = RtpsConfig {
///     domain: 7,
///     range: DiscoveryRange::Localhost,
///     ..RtpsConfig::default()
/// };
/// # let _ = config;
/// ```
#[derive(Debug, Clone)]
pub struct RtpsConfig {
    /// The domain, 0..=232 (`ROS_DOMAIN_ID`).
    pub domain: u16,
    /// The participants that are looked for without being named.
    pub range: DiscoveryRange,
    /// The versions of IP that are spoken.
    pub ip: IpVersions,
    /// Host names and addresses that are looked for besides (`ROS_STATIC_PEERS`).
    pub static_peers: Vec<String>,
    /// The IPv4 addresses of the interfaces that are used; empty: all that are up, also those that
    /// come up later, with whatever addresses they have at a time. At most four
    /// besides loopback, and two if IPv6 is used as well: then two of IPv6. Loopback alone reaches
    /// and hears this host alone, by IPv6 as well.
    pub interfaces: Vec<Ipv4Addr>,
    /// How long others wait for a sign of life before they forget this participant: 1 s to 1 h.
    pub lease: Duration,
    /// Bytes of a datagram to other hosts, 1200..=65000. Longer samples go in several.
    pub datagram: usize,
    /// Bytes of a datagram with samples whose readers are all on this host, 1200..=65000.
    pub host_datagram: usize,
    /// Whether samples from 16 kB on go to programs of replenish on this host through memory of the
    /// publisher, and not in datagrams (`REPLENISH_SHARED_MEMORY`).
    pub shared_memory: bool,
    /// Participants of others that are known at a time, 1..=1000.
    pub participants: usize,
    /// Endpoints of others that are known at a time, 1..=65536. About 700 bytes each.
    pub endpoints: usize,
    /// Our own publishers and our own subscriptions, 2..=10000 each, and 1024 subscriptions at
    /// most. One of each is that of `ros_discovery_info`.
    pub own_endpoints: usize,
    /// Peers of one of our endpoints, 1..=1000.
    pub matches: usize,
}

impl Default for RtpsConfig {
    /// Domain 0 on all interfaces, 64 participants with 2048 endpoints.
    fn default() -> Self {
        Self {
            domain: 0,
            range: DiscoveryRange::Subnet,
            ip: IpVersions::V4,
            static_peers: Vec::new(),
            interfaces: Vec::new(),
            lease: Duration::from_nanos(DEFAULT_LEASE),
            datagram: 1472,
            host_datagram: HOST_DATAGRAM,
            shared_memory: true,
            participants: 64,
            endpoints: 2048,
            own_endpoints: 256,
            matches: 32,
        }
    }
}

impl RtpsConfig {
    /// Whether loopback alone is used.
    pub(super) fn is_loopback(&self) -> bool {
        !self.interfaces.is_empty() && self.interfaces.iter().all(Ipv4Addr::is_loopback)
    }

    pub(super) fn limits(&self) -> Limits {
        Limits {
            participants: self.participants,
            endpoints: self.endpoints,
            own_endpoints: self.own_endpoints,
            matches: self.matches,
            ..Limits::default()
        }
    }
}

/// Taking part in a domain failed.
#[derive(Debug)]
#[non_exhaustive]
pub enum RtpsError {
    /// A setting is outside its range.
    Setting {
        /// The environment's variable or the field.
        field: &'static str,
        /// The value it was given.
        value: String,
        /// The allowed range.
        allowed: &'static str,
    },
    /// A static peer has no address of a version that is spoken.
    Peer {
        /// As it was given.
        peer: String,
        /// The system's error.
        source: io::Error,
    },
    /// The sockets or the participant could not be made.
    Open(OpenError),
    /// The operating system refused something else.
    Io {
        /// The action that failed.
        what: &'static str,
        /// Its error.
        source: io::Error,
    },
}

impl fmt::Display for RtpsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setting {
                field,
                value,
                allowed,
            } => write!(f, "{field} = {value:?} is not allowed: {allowed}"),
            Self::Peer { peer, source } => write!(
                f,
                "the static peer {peer:?} has no address that can be used (ROS_STATIC_PEERS is a \
                 list of host names and addresses, separated by semicolons; RtpsConfig::ip has \
                 the versions of IP): {source}"
            ),
            Self::Open(error) => error.fmt(f),
            Self::Io { what, source } => write!(f, "cannot {what}: {source}"),
        }
    }
}

impl core::error::Error for RtpsError {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Setting { .. } => None,
            Self::Open(error) => Some(error),
            Self::Peer { source, .. } | Self::Io { source, .. } => Some(source),
        }
    }
}

impl From<RtpsError> for Error {
    fn from(e: RtpsError) -> Self {
        Self::Connect {
            reason: text!("{e}"),
        }
    }
}

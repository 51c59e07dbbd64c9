//! Where and as whom to take part, and why that failed.

use super::interfaces::Interfaces;
use crate::participant::{ConfigError, DEFAULT_LEASE, Limits};
use crate::wire::Nanos;
use core::fmt;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};

/// The default of [`UdpConfig::host_datagram`]: no datagram over loopback is longer than 65 507.
pub const HOST_DATAGRAM: usize = 64_160;

/// Where and as whom to take part.
#[derive(Clone, Copy, Debug)]
pub struct UdpConfig<'a> {
    /// The domain, 0 to 232 (`ROS_DOMAIN_ID`).
    pub domain: u16,
    /// The IPv4 addresses of the interfaces that are used. One alone is the only one that
    /// datagrams are taken from; loopback reaches this host alone.
    pub interfaces: &'a [Ipv4Addr],
    /// The IPv6 addresses that are used besides, each with the index of its interface; empty: IPv4
    /// alone. If `interfaces` is empty, IPv6 is used alone. An address of link scope is none that
    /// peers can be told.
    pub interfaces6: &'a [(Ipv6Addr, u32)],
    /// Whether the interfaces may change: datagrams are taken from all that the host has, also
    /// where one alone is used now.
    pub follows: bool,
    /// Whether the multicast group of the domain is joined and announced to.
    pub multicast: bool,
    /// Addresses that announcements go to besides.
    pub peers: &'a [SocketAddr],
    /// How long others wait for a sign of life before they forget us, in nanoseconds, 1 s to 1 h.
    pub lease: Nanos,
    /// The enclave, in ROS 2 `/`.
    pub enclave: &'a str,
    /// Bytes of a datagram to other hosts, 1200 to 65 000.
    pub datagram: usize,
    /// Bytes of a datagram with samples whose readers are all on this host, 1200 to 65 000.
    pub host_datagram: usize,
    /// Bounds.
    pub limits: Limits,
}

impl UdpConfig<'_> {
    /// The interfaces that are told to peers.
    #[must_use]
    pub fn used(&self) -> Interfaces {
        Interfaces::of(self.interfaces, self.interfaces6)
    }

    /// Bytes of the longest datagram that is sent.
    #[must_use]
    pub fn longest_datagram(&self) -> usize {
        self.datagram.max(self.host_datagram)
    }
}

impl Default for UdpConfig<'_> {
    /// Domain 0 on the loopback interface.
    fn default() -> Self {
        UdpConfig {
            domain: 0,
            interfaces: &[Ipv4Addr::LOCALHOST],
            interfaces6: &[],
            follows: false,
            multicast: true,
            peers: &[],
            lease: DEFAULT_LEASE,
            enclave: "/",
            datagram: 1472,
            host_datagram: HOST_DATAGRAM,
            limits: Limits::default(),
        }
    }
}

/// Why a participant could not be opened.
#[derive(Debug)]
#[non_exhaustive]
pub enum OpenError {
    /// A field is outside of its range.
    Config(ConfigError),
    /// No interface was named.
    NoInterface,
    /// All 120 pairs of ports of the domain are taken.
    NoPort,
    /// A socket could not be made, with what was tried.
    Socket(&'static str, io::Error),
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OpenError::Config(error) => error.fmt(f),
            OpenError::NoInterface => f.write_str("interfaces is empty: at least one address"),
            OpenError::NoPort => f.write_str("all 120 pairs of ports of the domain are taken"),
            OpenError::Socket(what, error) => write!(f, "cannot {what}: {error}"),
        }
    }
}

impl core::error::Error for OpenError {}

//! Opening a participant: settings, addresses, sockets.

use super::adapter::Rtps;
use super::config::{DiscoveryRange, RtpsConfig, RtpsError};
use super::environment::Environment;
use crate::context::Context;
use crate::platform::tell;
use alloc::vec::Vec;
use replenish_os::ipv4_addresses;
use replenish_rtps::udp::UdpConfig;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs};

/// Participants of a host that are looked for where multicast is not used, as `rmw_fastrtps` does.
const LOOKED_FOR: u16 = 32;
/// Addresses that peers are told.
const MOST_INTERFACES: usize = 4;

impl Context {
    /// A context in ROS 2 itself, without an agent: a DDS participant that costs no thread.
    ///
    /// `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_STATIC_PEERS` and
    /// `ROS_LOCALHOST_ONLY` are read as ROS 2 reads them; [`Rtps::open`] and [`Context::new`] take
    /// other settings. Peers are found, and lost samples repaired, while an executor spins.
    ///
    /// # Errors
    /// [`RtpsError`]: a variable out of its range, a peer without an address, no free port.
    pub fn ros2() -> Result<Self, RtpsError> {
        let read = Environment::parse(|name| std::env::var(name).ok())?;
        read.warnings.iter().for_each(|warning| tell(warning));
        Rtps::open(&read.config).map(Self::new)
    }
}

impl Rtps {
    /// Takes part in a domain.
    ///
    /// # Errors
    /// [`RtpsError`].
    pub fn open(config: &RtpsConfig) -> Result<Self, RtpsError> {
        let interfaces = interfaces(config)?;
        let peers = peers(config)?;
        let udp = UdpConfig {
            domain: config.domain,
            interfaces: &interfaces,
            multicast: config.range == DiscoveryRange::Subnet,
            peers: &peers,
            lease: u64::try_from(config.lease.as_nanos()).unwrap_or(u64::MAX),
            enclave: "/",
            datagram: config.datagram,
            host_datagram: config.host_datagram,
            limits: config.limits(),
        };
        Self::over(&udp, config.range == DiscoveryRange::Off)
    }
}

/// Loopback alone, or everything that is up with loopback at the end: programs that keep to the
/// local host announce themselves there.
fn interfaces(config: &RtpsConfig) -> Result<Vec<Ipv4Addr>, RtpsError> {
    if config.range == DiscoveryRange::Localhost {
        return Ok([Ipv4Addr::LOCALHOST].into());
    }
    let mut used = config.interfaces.clone();
    if used.is_empty() {
        let up = ipv4_addresses().map_err(|source| RtpsError::Io {
            what: "list the interfaces",
            source,
        })?;
        used.extend(up.into_iter().filter(|ip| !ip.is_loopback()));
        used.truncate(MOST_INTERFACES);
        used.push(Ipv4Addr::LOCALHOST);
    }
    Ok(used)
}

/// The addresses that announcements go to besides the multicast group.
fn peers(config: &RtpsConfig) -> Result<Vec<SocketAddr>, RtpsError> {
    let mut peers = Vec::new();
    let mut add = |ip| peers.extend(UdpConfig::unicast(config.domain, ip, LOOKED_FOR));
    if config.range == DiscoveryRange::Off {
        return Ok(Vec::new());
    }
    if config.range == DiscoveryRange::Localhost {
        add(Ipv4Addr::LOCALHOST);
    }
    for peer in &config.static_peers {
        let error = |source| RtpsError::Peer {
            peer: peer.clone(),
            source,
        };
        let resolved = (peer.as_str(), 0).to_socket_addrs().map_err(error)?;
        let addresses = resolved.filter_map(|address| match address {
            SocketAddr::V4(v4) => Some(*v4.ip()),
            SocketAddr::V6(_) => None,
        });
        let mut addresses = addresses.peekable();
        if addresses.peek().is_none() {
            return Err(error(io::Error::from(ErrorKind::AddrNotAvailable)));
        }
        addresses.for_each(&mut add);
    }
    Ok(peers)
}

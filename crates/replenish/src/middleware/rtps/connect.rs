//! Opening a participant: settings, addresses, sockets.

use super::adapter::Rtps;
use super::config::{DiscoveryRange, IpVersions, RtpsConfig, RtpsError};
use super::environment::Environment;
use super::network::Network;
use crate::context::Context;
use crate::platform::tell;
use alloc::vec;
use alloc::vec::Vec;
use replenish_rtps::udp::{Interfaces, UdpConfig};
use std::io::{self, ErrorKind};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, ToSocketAddrs};

/// Participants of a host that are looked for where multicast is not used, as `rmw_fastrtps` does.
const LOOKED_FOR: u16 = 32;
/// The index of the interface `lo`, the first of each host.
const LOOPBACK: u32 = 1;

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
        let (participant, is_cut_off) = Rtps::opened(&read.config)?;
        if is_cut_off {
            tell(&NO_NETWORK);
        }
        Ok(Self::new(participant))
    }
}

impl Rtps {
    /// Takes part in a domain.
    ///
    /// # Errors
    /// [`RtpsError`].
    pub fn open(config: &RtpsConfig) -> Result<Self, RtpsError> {
        Self::opened(config).map(|(participant, _)| participant)
    }

    /// The participant, and whether it looks for other hosts without a way to them.
    fn opened(config: &RtpsConfig) -> Result<(Self, bool), RtpsError> {
        let (ip, peers) = peers(config)?;
        let alone = config.range == DiscoveryRange::Off;
        let follows = config.interfaces.is_empty();
        // Addresses of IPv6 cannot be named.
        let lists = follows || ip != IpVersions::V4;
        let network = lists.then(|| Network::new(ip)).transpose();
        let network = network.map_err(unlisted)?;
        let host = network.as_ref().map(Network::addresses).transpose();
        let host = host.map_err(unlisted)?.unwrap_or_default();
        let interfaces = interfaces(config, ip, &host);
        let interfaces6 = interfaces6(config, &host);
        let peers: Vec<_> = peers
            .into_iter()
            .flat_map(|ip| UdpConfig::unicast(config.domain, ip, LOOKED_FOR))
            .collect();
        let udp = UdpConfig {
            domain: config.domain,
            interfaces: &interfaces,
            interfaces6: &interfaces6,
            follows,
            multicast: config.range == DiscoveryRange::Subnet,
            peers: &peers,
            lease: u64::try_from(config.lease.as_nanos()).unwrap_or(u64::MAX),
            enclave: "/",
            datagram: config.datagram,
            host_datagram: config.host_datagram,
            limits: config.limits(),
        };
        let is_cut_off = is_cut_off(config, &host);
        let network = network.filter(|_| follows && !alone);
        let opened = Self::over(&udp, network, (alone, config.shared_memory))?;
        Ok((opened, is_cut_off))
    }
}

const NO_NETWORK: &str = "no network interface is up but loopback: programs on other hosts are \
    found when one is. ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST looks for none";

/// Whether programs on other hosts are looked for, and there is no way to them.
fn is_cut_off(config: &RtpsConfig, host: &Interfaces) -> bool {
    let looks = config.range == DiscoveryRange::Subnet && config.interfaces.is_empty();
    looks && host.is_local()
}

/// The named ones, or the host's. [`DiscoveryRange::Localhost`] has them all, too: a program
/// elsewhere that names this host as a static peer is answered, as by ROS 2.
fn interfaces(config: &RtpsConfig, ip: IpVersions, host: &Interfaces) -> Vec<Ipv4Addr> {
    if config.interfaces.is_empty() || ip == IpVersions::V6 {
        return host.v4().collect();
    }
    let mut used = config.interfaces.clone();
    if config.range == DiscoveryRange::Localhost && !config.is_loopback() {
        used.push(Ipv4Addr::LOCALHOST);
    }
    used
}

/// The same of IPv6.
fn interfaces6(config: &RtpsConfig, host: &Interfaces) -> Vec<(Ipv6Addr, u32)> {
    if config.is_loopback() && host.v6().next().is_some() {
        return vec![(Ipv6Addr::LOCALHOST, LOOPBACK)];
    }
    host.v6().collect()
}

fn unlisted(source: io::Error) -> RtpsError {
    RtpsError::Io {
        what: "list the interfaces",
        source,
    }
}

/// The versions of IP that are spoken, and the hosts that announcements go to besides the multicast
/// groups.
fn peers(config: &RtpsConfig) -> Result<(IpVersions, Vec<IpAddr>), RtpsError> {
    let is_local = config.range == DiscoveryRange::Localhost;
    let mut ip = match config.ip {
        IpVersions::Both if is_local => IpVersions::V4,
        ip => ip,
    };
    let mut hosts = Vec::new();
    if config.range == DiscoveryRange::Off {
        return Ok((ip, hosts));
    }
    if is_local {
        hosts.push(match ip {
            IpVersions::V6 => Ipv6Addr::LOCALHOST.into(),
            _ => Ipv4Addr::LOCALHOST.into(),
        });
    }
    for peer in &config.static_peers {
        let error = |source| RtpsError::Peer {
            peer: peer.clone(),
            source,
        };
        let resolved = (peer.as_str(), 0).to_socket_addrs().map_err(error)?;
        let all: Vec<IpAddr> = resolved.map(|address| address.ip()).collect();
        let (v4, v6): (Vec<_>, Vec<_>) = all.into_iter().partition(IpAddr::is_ipv4);
        let mut used = match ip {
            IpVersions::V4 => v4,
            IpVersions::V6 => Vec::new(),
            IpVersions::Both => [v4, v6.clone()].concat(),
        };
        if used.is_empty() {
            used = v6;
            if ip == IpVersions::V4 && !used.is_empty() {
                ip = IpVersions::Both;
            }
        }
        if used.is_empty() {
            return Err(error(io::Error::from(ErrorKind::AddrNotAvailable)));
        }
        hosts.append(&mut used);
    }
    Ok((ip, hosts))
}

#[test]
fn a_static_peer_of_ipv6_is_spoken_to_by_ipv6() {
    let read = |ip, range, named: &[&str]| {
        let config = RtpsConfig {
            ip,
            range,
            static_peers: named.iter().map(ToString::to_string).collect(),
            ..RtpsConfig::default()
        };
        let (ip, hosts) = peers(&config).ok()?;
        let hosts: Vec<_> = hosts.iter().map(ToString::to_string).collect();
        Some((ip, hosts))
    };
    let hosts = |all: &[&str]| all.iter().map(ToString::to_string).collect::<Vec<_>>();
    let (v4, v6, both) = (IpVersions::V4, IpVersions::V6, IpVersions::Both);
    let (subnet, local) = (DiscoveryRange::Subnet, DiscoveryRange::Localhost);
    for (asked, range, named, spoken) in [
        (
            v4,
            subnet,
            &["192.0.2.7"][..],
            Some((v4, hosts(&["192.0.2.7"]))),
        ),
        (v4, subnet, &["fd00::7"], Some((both, hosts(&["fd00::7"])))),
        (
            v4,
            subnet,
            &["192.0.2.7", "fd00::7"],
            Some((both, hosts(&["192.0.2.7", "fd00::7"]))),
        ),
        (v6, subnet, &["fd00::7"], Some((v6, hosts(&["fd00::7"])))),
        (v6, subnet, &["192.0.2.7"], None),
        (both, subnet, &[], Some((both, hosts(&[])))),
        (v4, local, &[], Some((v4, hosts(&["127.0.0.1"])))),
        (v6, local, &[], Some((v6, hosts(&["::1"])))),
        (both, local, &[], Some((v4, hosts(&["127.0.0.1"])))),
        (
            v4,
            local,
            &["fd00::7"],
            Some((both, hosts(&["127.0.0.1", "fd00::7"]))),
        ),
    ] {
        assert_eq!(
            read(asked, range, named),
            spoken,
            "{asked:?} {range:?} {named:?}"
        );
    }
}

#[test]
fn a_program_that_starts_before_the_network_is_warned() {
    let lacks = |range, named: &[Ipv4Addr], used: &[&str]| {
        let config = RtpsConfig {
            range,
            interfaces: named.to_vec(),
            ..RtpsConfig::default()
        };
        let mut host = Interfaces::default();
        used.iter().for_each(|ip| host.add(ip.parse().unwrap(), 1));
        is_cut_off(&config, &host)
    };
    let (subnet, local) = (DiscoveryRange::Subnet, DiscoveryRange::Localhost);
    assert!(lacks(subnet, &[], &["127.0.0.1"]));
    assert!(lacks(subnet, &[], &["127.0.0.1", "::1"]));
    assert!(!lacks(subnet, &[], &["192.0.2.7", "127.0.0.1"]));
    assert!(!lacks(subnet, &[], &["127.0.0.1", "fd00::7"]));
    assert!(!lacks(local, &[], &["127.0.0.1"]));
    assert!(!lacks(DiscoveryRange::Off, &[], &["127.0.0.1"]));
    // A program that names loopback wants no other.
    assert!(!lacks(subnet, &[Ipv4Addr::LOCALHOST], &["127.0.0.1"]));
}

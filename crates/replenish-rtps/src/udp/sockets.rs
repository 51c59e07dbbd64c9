//! [`Sockets`]: the sockets of a participant, as RTPS 2.5, 9.6.2.3 numbers them.

use super::config::{OpenError, UdpConfig};
use crate::participant::{Participant, ParticipantConfig};
use crate::wire::{GuidPrefix, Locators, Nanos};
use rustix::net::sockopt;
use rustix::net::{AddressFamily, SendFlags, SocketFlags, SocketType, bind, sendto, socket_with};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, SocketAddrV6, UdpSocket};
use std::os::fd::OwnedFd;
use std::vec::Vec;

/// The group that every participant of a domain listens to.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// The groups of IPv6, which RTPS does not name: Cyclone DDS's and Fast DDS's.
const GROUPS6: [Ipv6Addr; 2] = [
    Ipv6Addr::new(0xff02, 0, 0, 0, 0, 0xffff, 0xefff, 1),
    Ipv6Addr::new(0xff1e, 0, 0, 0, 0, 0xffff, 0xefff, 1),
];
/// Participants of a domain on one host that have ports of their own.
const MOST_PARTICIPANTS: u16 = 120;
/// Bytes asked for as a socket's receive buffer; the kernel may give less (`net.core.rmem_max`).
const RECEIVE_BUFFER: usize = 1 << 20;

/// The domain's multicast group, discovery, samples. None of them waits.
#[derive(Debug)]
pub struct Sockets {
    group: Option<UdpSocket>,
    group6: Option<UdpSocket>,
    discovery: UdpSocket,
    user: UdpSocket,
    bound: Bound,
    /// The addresses that peers are told, and that multicast goes out from.
    interfaces: Vec<Ipv4Addr>,
    /// The same of IPv6, with the index of the interface.
    interfaces6: Vec<(Ipv6Addr, u32)>,
    base: u16,
}

impl Sockets {
    /// Opens and binds them.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn open(config: &UdpConfig<'_>) -> Result<Self, OpenError> {
        // Checked before it is multiplied.
        let base = base_port(config.domain.min(232));
        let bound = Bound::of(config).ok_or(OpenError::NoInterface)?;
        let outside = config.interfaces.iter().filter(|ip| !ip.is_loopback());
        let mut interfaces: Vec<_> = outside.copied().collect();
        if interfaces.is_empty() {
            interfaces.extend(config.interfaces.first());
        }
        let all6 = config.interfaces6;
        let outside = all6.iter().filter(|(ip, _)| !ip.is_loopback());
        let mut interfaces6: Vec<_> = outside.copied().collect();
        if interfaces6.is_empty() {
            interfaces6.extend(all6.first());
        }
        let socket = |what| move |error| OpenError::Socket(what, error);
        let v4 = config.multicast && !interfaces.is_empty();
        let group = v4.then(|| group(base, &interfaces)).transpose();
        let group = group.map_err(socket("join the multicast group"))?;
        let v6 = config.multicast && !interfaces6.is_empty();
        let group6 = v6.then(|| group6(base, &interfaces6)).transpose();
        let group6 = group6.map_err(socket("join the multicast groups of IPv6"))?;
        let (discovery, user) = pair(base, bound)?;
        let sockets = Sockets {
            group,
            group6,
            discovery,
            user,
            bound,
            interfaces,
            interfaces6,
            base,
        };
        for each in sockets.all().into_iter().flatten() {
            prepare(each).map_err(socket("prepare a socket"))?;
        }
        Ok(sockets)
    }

    /// The participant that is reached at these sockets.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn participant(
        &self,
        config: &UdpConfig<'_>,
        now: Nanos,
    ) -> Result<Participant, OpenError> {
        let address = |of| {
            self.addresses(of)
                .map_err(|e| OpenError::Socket("read an address", e))
        };
        let mut announce_to = config.peers.to_vec();
        if self.group.is_some() {
            announce_to.push(SocketAddr::V4(SocketAddrV4::new(GROUP, self.base)));
        }
        if self.group6.is_some() {
            let groups = GROUPS6.map(|group| SocketAddr::from((group, self.base)));
            announce_to.extend(groups);
        }
        let settings = ParticipantConfig {
            domain: u32::from(config.domain),
            discovery: address(&self.discovery)?,
            user: address(&self.user)?,
            announce_to: &announce_to,
            lease: config.lease,
            enclave: config.enclave,
            datagram: config.datagram,
            host_datagram: config.host_datagram,
            host_burst: self.burst(),
            limits: config.limits,
            ..ParticipantConfig::new(prefix())
        };
        Participant::new(&settings, now).map_err(OpenError::Config)
    }

    /// The sockets that receive: the group if there is one, discovery, samples, and the group of
    /// IPv6 if there is one.
    #[must_use]
    pub const fn all(&self) -> [Option<&UdpSocket>; 4] {
        [
            self.group.as_ref(),
            Some(&self.discovery),
            Some(&self.user),
            self.group6.as_ref(),
        ]
    }

    /// A socket for one reader alone, and where it is reached.
    ///
    /// # Errors
    /// The errors of `socket(2)` and `bind(2)`.
    pub fn for_reader(&self) -> io::Result<(UdpSocket, Locators)> {
        let socket = self.bound.open(0)?;
        prepare(&socket)?;
        let reached = self.addresses(&socket)?;
        Ok((socket, reached))
    }

    /// Sends a datagram, to a group from every interface; whether the kernel took it.
    pub fn send(&self, datagram: &[u8], to: SocketAddr) -> bool {
        // Past the C library, which does more around it so that its threads can be cancelled.
        let way = self.bound.way_to(to);
        let send = || sendto(&self.user, datagram, SendFlags::empty(), &way).is_ok();
        if !to.ip().is_multicast() {
            return send();
        }
        let mut sent = false;
        if to.is_ipv6() {
            for (_, index) in &self.interfaces6 {
                let chosen = sockopt::set_ipv6_multicast_if(&self.user, *index);
                sent |= chosen.is_ok() && send();
            }
            return sent;
        }
        for interface in &self.interfaces {
            let chosen = sockopt::set_ip_multicast_if(&self.user, interface);
            sent |= chosen.is_ok() && send();
        }
        sent
    }

    /// Half of what the kernel keeps for a socket of ours, which counts more than the bytes.
    fn burst(&self) -> usize {
        let kept = sockopt::socket_recv_buffer_size(&self.user).unwrap_or(0);
        (kept / 2).clamp(64_000, RECEIVE_BUFFER)
    }

    fn addresses(&self, socket: &UdpSocket) -> io::Result<Locators> {
        let port = socket.local_addr()?.port();
        let v4 = self.interfaces.iter().map(|ip| IpAddr::V4(*ip));
        let v6 = self.interfaces6.iter().map(|(ip, _)| IpAddr::V6(*ip));
        let all = v4.chain(v6);
        Ok(all.map(|ip| SocketAddr::new(ip, port)).collect())
    }
}

impl UdpConfig<'_> {
    /// The addresses of the first `participants` (at most 120) of this domain on the host `ip`: for
    /// [`UdpConfig::peers`] where there is no multicast.
    pub fn unicast(
        domain: u16,
        ip: impl Into<IpAddr>,
        participants: u16,
    ) -> impl Iterator<Item = SocketAddr> {
        let ip = ip.into();
        let base = base_port(domain.min(232));
        let places = 0..participants.min(MOST_PARTICIPANTS);
        places.map(move |place| SocketAddr::new(ip, discovery_port(base, place)))
    }
}

fn base_port(domain: u16) -> u16 {
    7400u16.saturating_add(domain.saturating_mul(250))
}

fn discovery_port(base: u16, participant: u16) -> u16 {
    let place = participant.saturating_mul(2);
    base.saturating_add(10).saturating_add(place)
}

fn prepare(socket: &UdpSocket) -> io::Result<()> {
    socket.set_nonblocking(true)?;
    // As much as the kernel gives.
    sockopt::set_socket_recv_buffer_size(socket, RECEIVE_BUFFER).unwrap_or_default();
    Ok(())
}

/// A name that no other participant has: 10 random bytes.
fn prefix() -> GuidPrefix {
    let mut bytes = [0; 12];
    let random = [
        RandomState::new().hash_one(0),
        RandomState::new().hash_one(1),
    ];
    let random = random.iter().flat_map(|word| word.to_le_bytes());
    for (to, from) in bytes.iter_mut().skip(2).zip(random) {
        *to = from;
    }
    GuidPrefix(bytes)
}

/// Every participant of the host listens to the same port.
fn group(port: u16, interfaces: &[Ipv4Addr]) -> io::Result<UdpSocket> {
    let fd = socket_with(
        AddressFamily::INET,
        SocketType::DGRAM,
        SocketFlags::CLOEXEC,
        None,
    )?;
    sockopt::set_socket_reuseaddr(&fd, true)?;
    bind(&fd, &SocketAddrV4::new(GROUP, port))?;
    let socket = UdpSocket::from(fd);
    for interface in interfaces {
        socket.join_multicast_v4(&GROUP, interface)?;
    }
    Ok(socket)
}

/// A socket of IPv6; if not `only`, datagrams of IPv4 come to it as well.
fn unbound6(only: bool) -> io::Result<OwnedFd> {
    let (family, kind) = (AddressFamily::INET6, SocketType::DGRAM);
    let fd = socket_with(family, kind, SocketFlags::CLOEXEC, None)?;
    sockopt::set_ipv6_v6only(&fd, only)?;
    Ok(fd)
}

/// Joins the groups of IPv6 on each interface, as far as the interface has multicast: loopback need
/// not.
fn group6(port: u16, interfaces: &[(Ipv6Addr, u32)]) -> io::Result<UdpSocket> {
    let fd = unbound6(true)?;
    sockopt::set_socket_reuseaddr(&fd, true)?;
    bind(&fd, &SocketAddrV6::new(Ipv6Addr::UNSPECIFIED, port, 0, 0))?;
    let socket = UdpSocket::from(fd);
    for (_, index) in interfaces {
        for group in &GROUPS6 {
            match socket.join_multicast_v6(group, *index) {
                // Two addresses of one interface.
                Err(error) if error.kind() == io::ErrorKind::AddrInUse => {}
                joined => joined?,
            }
        }
    }
    Ok(socket)
}

/// The address that sockets are bound to.
#[derive(Clone, Copy, Debug)]
struct Bound {
    ip: IpAddr,
    /// A socket of IPv6 takes datagrams of IPv4 besides.
    both: bool,
}

impl Bound {
    /// The only interface, or all of them; `None` if there is none.
    fn of(config: &UdpConfig<'_>) -> Option<Self> {
        let ip = match (config.interfaces, config.interfaces6) {
            ([], []) => return None,
            ([one], []) => IpAddr::V4(*one),
            (_, []) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            ([], [(one, _)]) => IpAddr::V6(*one),
            _ => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let both = !config.interfaces.is_empty();
        Some(Bound { ip, both })
    }

    fn open(self, port: u16) -> io::Result<UdpSocket> {
        if self.ip.is_ipv4() {
            return UdpSocket::bind((self.ip, port));
        }
        let fd = unbound6(!self.both)?;
        bind(&fd, &SocketAddr::new(self.ip, port))?;
        Ok(UdpSocket::from(fd))
    }

    /// The address as a socket that is bound like this takes it.
    fn way_to(self, to: SocketAddr) -> SocketAddr {
        match to {
            SocketAddr::V4(v4) if self.ip.is_ipv6() => {
                SocketAddr::new(v4.ip().to_ipv6_mapped().into(), v4.port())
            }
            _ => to,
        }
    }
}

/// The first free pair of ports: discovery and samples.
fn pair(base: u16, bound: Bound) -> Result<(UdpSocket, UdpSocket), OpenError> {
    for participant in 0..MOST_PARTICIPANTS {
        let port = discovery_port(base, participant);
        let open = |port| bound.open(port);
        match open(port).and_then(|first| Ok((first, open(port.saturating_add(1))?))) {
            Ok(sockets) => return Ok(sockets),
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {}
            Err(error) => return Err(OpenError::Socket("bind a port", error)),
        }
    }
    Err(OpenError::NoPort)
}

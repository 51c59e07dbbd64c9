//! [`Sockets`]: the sockets of a participant, as RTPS 2.5, 9.6.2.3 numbers them.

use super::config::{OpenError, UdpConfig};
use super::interfaces::Interfaces;
use crate::participant::{Participant, ParticipantConfig};
use crate::wire::{GuidPrefix, Nanos};
use rustix::net::sockopt;
use rustix::net::{AddressFamily, SendFlags, SocketFlags, SocketType, bind, sendto, socket_with};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, SocketAddrV6, UdpSocket};
use std::os::fd::OwnedFd;
use std::time::Instant;

/// The group that every participant of a domain listens to.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// The groups of IPv6, which RTPS does not name: Cyclone DDS's and Fast DDS's.
const GROUPS6: [Ipv6Addr; 2] = [
    Ipv6Addr::new(0xff02, 0, 0, 0, 0, 0xffff, 0xefff, 1),
    Ipv6Addr::new(0xff1e, 0, 0, 0, 0, 0xffff, 0xefff, 1),
];
/// Participants of a domain on one host that have ports of their own.
const MOST_PARTICIPANTS: u16 = 120;
/// Ports of a domain: its multicast, and those of its participants.
const BLOCK: u16 = 250;
/// The last ports of a domain, which readers take first: its first sixty participants use none of
/// them.
const READER_PORTS: u16 = 120;
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
        let used = config.used();
        let socket = |what| move |error| OpenError::Socket(what, error);
        let v4 = config.multicast && !config.interfaces.is_empty();
        let group = v4.then(|| group(base)).transpose();
        let group = group.map_err(socket("listen to the multicast group"))?;
        let v6 = config.multicast && !config.interfaces6.is_empty();
        let group6 = v6.then(|| group6(base)).transpose();
        let group6 = group6.map_err(socket("listen to the multicast groups of IPv6"))?;
        let (discovery, user) = pair(base, bound)?;
        let sockets = Sockets {
            group,
            group6,
            discovery,
            user,
            bound,
            base,
        };
        let joined = sockets.join(&used);
        joined.map_err(socket("join the multicast group"))?;
        for each in sockets.all().into_iter().flatten() {
            prepare(each).map_err(socket("prepare a socket"))?;
        }
        Ok(sockets)
    }

    /// From now on listens to the domain's multicast groups on the interfaces of `now` instead of
    /// those of `before`; on loopback still. The participant is told by
    /// [`move_to`](Participant::move_to).
    ///
    /// # Errors
    /// The first error of `setsockopt(2)`; the other interfaces are listened to all the same.
    pub fn follow(&self, before: &Interfaces, now: &Interfaces) -> io::Result<()> {
        // The kernel has left the groups of an interface that is gone: no error counts.
        if let Some(socket) = &self.group {
            let gone = before.v4().filter(|ip| now.v4().all(|kept| kept != *ip));
            let gone = gone.filter(|ip| !ip.is_loopback());
            gone.for_each(|ip| socket.leave_multicast_v4(&GROUP, &ip).unwrap_or_default());
        }
        if let Some(socket) = &self.group6 {
            let gone = before
                .v6()
                .filter(|(_, at)| now.v6().all(|(_, kept)| kept != *at));
            let gone = gone.filter(|(ip, _)| !ip.is_loopback());
            for (group, at) in gone.flat_map(|(_, at)| GROUPS6.map(|group| (group, at))) {
                socket.leave_multicast_v6(&group, at).unwrap_or_default();
            }
        }
        self.join(now)
    }

    fn join(&self, interfaces: &Interfaces) -> io::Result<()> {
        let mut first = Ok(());
        let mut note = |joined: io::Result<()>| match joined {
            // Two addresses of one interface, or one that was joined before.
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {}
            Err(error) if first.is_ok() => first = Err(error),
            _ => {}
        };
        if let Some(socket) = &self.group {
            let all = interfaces.v4();
            all.for_each(|ip| note(socket.join_multicast_v4(&GROUP, &ip)));
        }
        if let Some(socket) = &self.group6 {
            for (group, at) in interfaces
                .v6()
                .flat_map(|(_, at)| GROUPS6.map(|group| (group, at)))
            {
                note(socket.join_multicast_v6(&group, at));
            }
        }
        first
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
        let used = config.used();
        let address = |of: &UdpSocket| match of.local_addr() {
            Ok(address) => Ok(used.at(address.port())),
            Err(error) => Err(OpenError::Socket("read an address", error)),
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
            ..ParticipantConfig::new(prefix(&RandomState::new()))
        };
        let mut participant = Participant::new(&settings, now).map_err(OpenError::Config)?;
        participant.expect_moves();
        Ok(participant)
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

    /// A socket for one reader alone, and its port: one of the domain's last 120, which a firewall
    /// for the domain lets pass, or any other when they are taken.
    ///
    /// # Errors
    /// The errors of `socket(2)` and `bind(2)`.
    pub fn for_reader(&self) -> io::Result<(UdpSocket, u16)> {
        let begin = self.base.saturating_add(BLOCK - READER_PORTS);
        let ports = begin..self.base.saturating_add(BLOCK);
        let socket = match ports.rev().find_map(|port| self.bound.open(port).ok()) {
            Some(socket) => socket,
            None => self.bound.open(0)?,
        };
        prepare(&socket)?;
        let port = socket.local_addr()?.port();
        Ok((socket, port))
    }

    /// Sends a datagram, to a group from each of the interfaces; whether the kernel took it.
    pub fn send(&self, datagram: &[u8], to: SocketAddr, interfaces: &Interfaces) -> bool {
        // Past the C library, which does more around it so that its threads can be cancelled.
        let way = self.bound.way_to(to);
        let send = || sendto(&self.user, datagram, SendFlags::empty(), &way).is_ok();
        if !to.ip().is_multicast() {
            return send();
        }
        let mut sent = false;
        if to.is_ipv6() {
            for (_, index) in interfaces.v6() {
                let chosen = sockopt::set_ipv6_multicast_if(&self.user, index);
                sent |= chosen.is_ok() && send();
            }
            return sent;
        }
        for ip in interfaces.v4() {
            let chosen = sockopt::set_ip_multicast_if(&self.user, &ip);
            sent |= chosen.is_ok() && send();
        }
        sent
    }

    /// Half of what the kernel keeps for a socket of ours, which counts more than the bytes.
    fn burst(&self) -> usize {
        let kept = sockopt::socket_recv_buffer_size(&self.user).unwrap_or(0);
        (kept / 2).clamp(64_000, RECEIVE_BUFFER)
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
    7400u16.saturating_add(domain.saturating_mul(BLOCK))
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

/// A name that no other participant has: 10 random bytes. A forked child has its parent's keys,
/// but not its process and time.
fn prefix(keys: &RandomState) -> GuidPrefix {
    let mut bytes = [0; 12];
    let own = (std::process::id(), Instant::now());
    let random = [keys.hash_one((0, own)), keys.hash_one((1, own))];
    let random = random.iter().flat_map(|word| word.to_le_bytes());
    for (to, from) in bytes.iter_mut().skip(2).zip(random) {
        *to = from;
    }
    GuidPrefix(bytes)
}

/// Every participant of the host listens to the same port.
fn group(port: u16) -> io::Result<UdpSocket> {
    let (family, kind) = (AddressFamily::INET, SocketType::DGRAM);
    let fd = socket_with(family, kind, SocketFlags::CLOEXEC, None)?;
    sockopt::set_socket_reuseaddr(&fd, true)?;
    bind(&fd, &SocketAddrV4::new(GROUP, port))?;
    Ok(UdpSocket::from(fd))
}

/// A socket of IPv6; if not `only`, datagrams of IPv4 come to it as well.
fn unbound6(only: bool) -> io::Result<OwnedFd> {
    let (family, kind) = (AddressFamily::INET6, SocketType::DGRAM);
    let fd = socket_with(family, kind, SocketFlags::CLOEXEC, None)?;
    sockopt::set_ipv6_v6only(&fd, only)?;
    Ok(fd)
}

/// The same of IPv6.
fn group6(port: u16) -> io::Result<UdpSocket> {
    let fd = unbound6(true)?;
    sockopt::set_socket_reuseaddr(&fd, true)?;
    bind(&fd, &SocketAddrV6::new(Ipv6Addr::UNSPECIFIED, port, 0, 0))?;
    Ok(UdpSocket::from(fd))
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
            ([one], []) if !config.follows => IpAddr::V4(*one),
            (_, []) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            ([], [(one, _)]) if !config.follows => IpAddr::V6(*one),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn sockets() -> (Sockets, u16) {
        let domain = replenish_testkit::domain::domain();
        let config = UdpConfig {
            domain,
            multicast: false,
            ..UdpConfig::default()
        };
        (Sockets::open(&config).unwrap(), base_port(domain))
    }

    /// As forked children have them.
    #[test]
    fn with_the_same_keys_names_differ() {
        let keys = RandomState::new();
        assert_ne!(prefix(&keys), prefix(&keys));
    }

    /// A firewall that follows `replenish doctor` lets these ports of the domain pass.
    #[test]
    fn readers_have_ports_of_the_domain_while_there_are_some() {
        let (sockets, base) = sockets();
        let mut held = std::vec::Vec::new();
        for _ in 0..READER_PORTS {
            let (socket, port) = sockets.for_reader().unwrap();
            assert!((base + 130..base + 250).contains(&port), "{port}");
            assert_eq!(socket.local_addr().unwrap().port(), port);
            held.push(socket);
        }
        let (_, port) = sockets.for_reader().unwrap();
        assert!(!(base..base + 250).contains(&port), "{port}");
    }
}

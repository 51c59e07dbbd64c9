//! [`Sockets`]: the sockets of a participant, as RTPS 2.5, 9.6.2.3 numbers them.

use super::config::{OpenError, UdpConfig};
use crate::participant::{Participant, ParticipantConfig};
use crate::wire::{GuidPrefix, Locators, Nanos};
use rustix::net::sockopt;
use rustix::net::{AddressFamily, SendFlags, SocketFlags, SocketType, bind, sendto, socket_with};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::vec::Vec;

/// The group that every participant of a domain listens to.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Participants of a domain on one host that have ports of their own.
const MOST_PARTICIPANTS: u16 = 120;
/// Bytes asked for as a socket's receive buffer; the kernel may give less (`net.core.rmem_max`).
const RECEIVE_BUFFER: usize = 1 << 20;

/// The domain's multicast group, discovery, samples. None of them waits.
#[derive(Debug)]
pub struct Sockets {
    group: Option<UdpSocket>,
    discovery: UdpSocket,
    user: UdpSocket,
    /// The address that sockets are bound to.
    bound: Ipv4Addr,
    /// The addresses that peers are told, and that multicast goes out from.
    interfaces: Vec<Ipv4Addr>,
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
        let first = *config.interfaces.first().ok_or(OpenError::NoInterface)?;
        let several = config.interfaces.len() > 1;
        let bound = if several {
            Ipv4Addr::UNSPECIFIED
        } else {
            first
        };
        let outside = config.interfaces.iter().filter(|ip| !ip.is_loopback());
        let mut interfaces: Vec<_> = outside.copied().collect();
        if interfaces.is_empty() {
            interfaces.push(first);
        }
        let socket = |what| move |error| OpenError::Socket(what, error);
        let group = config.multicast.then(|| group(base, &interfaces));
        let group = group.transpose();
        let group = group.map_err(socket("join the multicast group"))?;
        let (discovery, user) = pair(base, bound)?;
        let sockets = Sockets {
            group,
            discovery,
            user,
            bound,
            interfaces,
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

    /// The sockets that receive: the group if there is one, discovery, samples.
    #[must_use]
    pub const fn all(&self) -> [Option<&UdpSocket>; 3] {
        [self.group.as_ref(), Some(&self.discovery), Some(&self.user)]
    }

    /// A socket for one reader alone, and where it is reached.
    ///
    /// # Errors
    /// The errors of `socket(2)` and `bind(2)`.
    pub fn for_reader(&self) -> io::Result<(UdpSocket, Locators)> {
        let socket = UdpSocket::bind(SocketAddrV4::new(self.bound, 0))?;
        prepare(&socket)?;
        let reached = self.addresses(&socket)?;
        Ok((socket, reached))
    }

    /// Sends a datagram, to a group from every interface; whether the kernel took it.
    pub fn send(&self, datagram: &[u8], to: SocketAddr) -> bool {
        // Past the C library, which does more around it so that its threads can be cancelled.
        let send = || sendto(&self.user, datagram, SendFlags::empty(), &to).is_ok();
        if !to.ip().is_multicast() {
            return send();
        }
        let mut sent = false;
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
        let on = |ip: &Ipv4Addr| SocketAddr::V4(SocketAddrV4::new(*ip, port));
        Ok(self.interfaces.iter().map(on).collect())
    }
}

impl UdpConfig<'_> {
    /// The addresses of the first `participants` (at most 120) of this domain on the host `ip`: for
    /// [`UdpConfig::peers`] where there is no multicast.
    pub fn unicast(
        domain: u16,
        ip: Ipv4Addr,
        participants: u16,
    ) -> impl Iterator<Item = SocketAddr> {
        let base = base_port(domain.min(232));
        let places = 0..participants.min(MOST_PARTICIPANTS);
        places.map(move |place| SocketAddr::V4(SocketAddrV4::new(ip, discovery_port(base, place))))
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

/// The first free pair of ports: discovery and samples.
fn pair(base: u16, bound: Ipv4Addr) -> Result<(UdpSocket, UdpSocket), OpenError> {
    for participant in 0..MOST_PARTICIPANTS {
        let port = discovery_port(base, participant);
        let open = |port| UdpSocket::bind(SocketAddrV4::new(bound, port));
        match open(port).and_then(|first| Ok((first, open(port.saturating_add(1))?))) {
            Ok(sockets) => return Ok(sockets),
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {}
            Err(error) => return Err(OpenError::Socket("bind a port", error)),
        }
    }
    Err(OpenError::NoPort)
}

//! The address of a client: UDP, TCP or a serial line.

use replenish_xrce::wire::ClientKey;
use std::fmt;
use std::net::{IpAddr, SocketAddr};

/// The other end of a datagram's way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Peer {
    /// A UDP address, reached through the `port`-th socket.
    Udp { port: usize, addr: SocketAddr },
    /// The `number`-th TCP connection.
    Tcp { number: u64, addr: SocketAddr },
    /// A UDP address that has shown over DTLS that it is client `key`.
    #[cfg_attr(
        not(feature = "secure"),
        expect(dead_code, reason = "only the DTLS port has such peers")
    )]
    Dtls { addr: SocketAddr, key: ClientKey },
    /// The `number`-th TCP connection, which has shown over TLS that it is client `key`.
    Tls {
        number: u64,
        addr: SocketAddr,
        key: ClientKey,
    },
    /// An address on a serial line; lines are numbered in the order of the configuration.
    Serial { line: usize, address: u8 },
}

impl Peer {
    /// Whether it receives what is sent to it: it shook hands, or is at the end of a line.
    pub(super) fn is_connected(&self) -> bool {
        !matches!(self, Self::Udp { .. })
    }

    /// The host, of one on a network.
    pub(super) fn host(&self) -> Option<IpAddr> {
        match self {
            Self::Udp { addr, .. }
            | Self::Tcp { addr, .. }
            | Self::Dtls { addr, .. }
            | Self::Tls { addr, .. } => Some(addr.ip()),
            Self::Serial { .. } => None,
        }
    }

    /// The client that it has shown to be.
    pub(super) fn identity(&self) -> Option<ClientKey> {
        match self {
            Self::Dtls { key, .. } | Self::Tls { key, .. } => Some(*key),
            _ => None,
        }
    }
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp { addr, .. } => write!(f, "udp {addr}"),
            Self::Tcp { addr, .. } => write!(f, "tcp {addr}"),
            Self::Dtls { addr, .. } => write!(f, "dtls {addr}"),
            Self::Tls { addr, .. } => write!(f, "tls {addr}"),
            Self::Serial { line, address } => write!(f, "serial line {line} address {address}"),
        }
    }
}

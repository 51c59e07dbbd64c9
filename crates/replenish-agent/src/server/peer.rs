//! Where a client is.

use std::fmt;
use std::net::SocketAddr;

/// Where datagrams come from and go to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Peer {
    /// A UDP address, reached through the `port`-th socket.
    Udp { port: usize, addr: SocketAddr },
    /// The `number`-th TCP connection.
    Tcp { number: u64, addr: SocketAddr },
    /// An address on a serial line; lines are numbered in the order of the configuration.
    Serial { line: usize, address: u8 },
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp { addr, .. } => write!(f, "udp {addr}"),
            Self::Tcp { addr, .. } => write!(f, "tcp {addr}"),
            Self::Serial { line, address } => write!(f, "serial line {line} address {address}"),
        }
    }
}

//! The UDP socket.

use crate::error::AgentError;
use replenish_os::{PollFd, clock, poll};
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

/// The longest datagram that UDP can carry.
const MAX_DATAGRAM: usize = 65_535;

/// An interface that takes nothing for that long loses its datagrams: clients behind
/// other interfaces do not wait for it.
const MAX_SEND: u64 = 1_000_000;

/// A bound UDP socket with a receive buffer.
#[derive(Debug)]
pub(super) struct UdpPort {
    socket: UdpSocket,
    addr: SocketAddr,
    buf: Box<[u8]>,
}

/// The result of one receive.
pub(super) enum Arrival<'a> {
    /// There is nothing to receive, for now.
    Nothing,
    /// An empty datagram or a passing error; there may be more.
    Ignored,
    /// A datagram and its sender; there may be more.
    Datagram(SocketAddr, &'a [u8]),
}

impl UdpPort {
    pub(super) fn bind(addr: SocketAddr) -> Result<Self, AgentError> {
        let error = |error| AgentError::new("listen at", addr, error);
        let socket = UdpSocket::bind(addr).map_err(error)?;
        socket.set_nonblocking(true).map_err(error)?;
        let addr = socket.local_addr().map_err(error)?;
        let buf = vec![0; MAX_DATAGRAM].into_boxed_slice();
        Ok(Self { socket, addr, buf })
    }

    pub(super) fn local_addr(&self) -> SocketAddr {
        self.addr
    }

    /// Takes a datagram if there is one.
    pub(super) fn receive(&mut self) -> Result<Arrival<'_>, AgentError> {
        match self.socket.recv_from(&mut self.buf) {
            Ok((0, _)) => Ok(Arrival::Ignored),
            Ok((len, from)) => {
                let bytes = self.buf.get(..len).unwrap_or_default();
                Ok(Arrival::Datagram(from, bytes))
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(Arrival::Nothing),
            Err(error) if is_passing(&error) => Ok(Arrival::Ignored),
            Err(error) => Err(AgentError::new("receive at", self.addr, error)),
        }
    }

    /// Sends a datagram; returns whether the operating system took it.
    pub(super) fn send(&self, to: SocketAddr, bytes: &[u8]) -> bool {
        for _ in 0..2 {
            match self.socket.send_to(bytes, to) {
                Ok(sent) => return sent == bytes.len(),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    let deadline = clock::monotonic().saturating_add(MAX_SEND);
                    if poll(&mut [PollFd::writable(self)], Some(deadline)).is_err() {
                        return false;
                    }
                }
                Err(_) => return false,
            }
        }
        false
    }
}

impl AsFd for UdpPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

/// Whether receiving can go on after the error: a signal came, or a client that was sent a
/// datagram is gone.
fn is_passing(error: &io::Error) -> bool {
    use ErrorKind::{
        ConnectionRefused, ConnectionReset, HostUnreachable, Interrupted, NetworkUnreachable,
        TimedOut,
    };
    matches!(
        error.kind(),
        TimedOut
            | Interrupted
            | ConnectionRefused
            | ConnectionReset
            | HostUnreachable
            | NetworkUnreachable
    )
}

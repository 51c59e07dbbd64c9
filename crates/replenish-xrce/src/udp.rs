//! UDP for a client: a non-blocking socket connected to the agent.

pub use crate::sent::Sent;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

/// A client's way to its agent. No method waits; [`AsFd`] is for waiting elsewhere. All methods may
/// be called from any thread.
#[derive(Debug)]
pub struct UdpTransport {
    socket: UdpSocket,
    agent: SocketAddr,
}

impl UdpTransport {
    /// A socket at a free port, connected to `agent`: it takes datagrams from there only.
    ///
    /// # Errors
    /// The system's error of socket, bind or connect.
    pub fn connect(agent: SocketAddr) -> io::Result<Self> {
        let any: SocketAddr = match agent {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)?;
        socket.connect(agent)?;
        socket.set_nonblocking(true)?;
        Ok(UdpTransport { socket, agent })
    }

    /// The agent's address.
    #[must_use]
    pub const fn agent(&self) -> SocketAddr {
        self.agent
    }

    /// The socket's own address.
    ///
    /// # Errors
    /// The system's error.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Sends a datagram.
    ///
    /// # Errors
    /// The system's error, unless [`Sent`] has a name for it.
    pub fn send(&self, datagram: &[u8]) -> io::Result<Sent> {
        // A refusal is about an earlier datagram; this one has then not been sent.
        for _ in 0..2 {
            match self.socket.send(datagram) {
                Ok(_) => return Ok(Sent::Yes),
                Err(error) => match error.kind() {
                    ErrorKind::ConnectionRefused | ErrorKind::Interrupted => {}
                    ErrorKind::WouldBlock => return Ok(Sent::Full),
                    ErrorKind::HostUnreachable
                    | ErrorKind::NetworkUnreachable
                    | ErrorKind::NetworkDown => return Ok(Sent::Unreachable),
                    _ => return Err(error),
                },
            }
        }
        Ok(Sent::Unreachable)
    }

    /// Receives a datagram, if there is one. A longer one is cut off.
    ///
    /// # Errors
    /// The system's error, except for "nothing there" and "no way to the agent".
    pub fn recv(&self, buf: &mut [u8]) -> io::Result<Option<usize>> {
        loop {
            match self.socket.recv(buf) {
                Ok(len) => return Ok(Some(len)),
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock => return Ok(None),
                    // News of datagrams sent earlier; the system reports each once, so that this
                    // ends.
                    ErrorKind::ConnectionRefused
                    | ErrorKind::HostUnreachable
                    | ErrorKind::NetworkUnreachable
                    | ErrorKind::Interrupted => {}
                    _ => return Err(error),
                },
            }
        }
    }
}

impl AsFd for UdpTransport {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sends_and_receives_without_waiting() {
        let peer = UdpSocket::bind("127.0.0.1:0").unwrap();
        let transport = UdpTransport::connect(peer.local_addr().unwrap()).unwrap();
        let mut buf = [0; 4];
        assert_eq!(transport.recv(&mut buf).unwrap(), None);
        assert_eq!(transport.send(b"ping").unwrap(), Sent::Yes);
        let (len, from) = peer.recv_from(&mut buf).unwrap();
        assert_eq!(
            (&buf[..len], from.port()),
            (&b"ping"[..], transport.local_addr().unwrap().port())
        );
        peer.send_to(b"pong", from).unwrap();
        while transport.recv(&mut buf).unwrap().is_none() {}
        assert_eq!(&buf, b"pong");
    }

    #[test]
    fn nobody_at_the_address_is_no_error() {
        let free = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let transport = UdpTransport::connect(free).unwrap();
        for _ in 0..10 {
            let sent = transport.send(b"hello").unwrap();
            assert!(matches!(sent, Sent::Yes | Sent::Unreachable), "{sent:?}");
            assert_eq!(transport.recv(&mut [0; 4]).unwrap(), None);
        }
    }
}

//! The socket: receiving and sending with a time limit.

use crate::config::Nanos;
use crate::error::AgentError;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

/// The longest datagram that UDP can carry.
const MAX_DATAGRAM: usize = 65_535;

/// Nothing waits longer than this, so that a wake-up that got lost delays a stop by no more.
const MAX_WAIT: Duration = Duration::from_secs(1);

/// When an interface takes nothing for that long, datagrams to it are dropped: whoever is reached
/// through another one does not wait.
const MAX_SEND: Duration = Duration::from_millis(1);

/// A bound UDP socket with a receive buffer.
#[derive(Debug)]
pub(super) struct Port {
    socket: UdpSocket,
    addr: SocketAddr,
    buf: Box<[u8]>,
    /// How long the socket waits now.
    timeout: Duration,
}

/// What ended a wait.
pub(super) enum Arrival<'a> {
    /// The time, or something that concerns nobody.
    Nothing,
    /// A datagram and its sender.
    Datagram(SocketAddr, &'a [u8]),
}

impl Port {
    pub(super) fn bind(addr: SocketAddr) -> Result<Self, AgentError> {
        let error = |error| AgentError::new("listen at", addr, error);
        let socket = UdpSocket::bind(addr).map_err(error)?;
        socket.set_read_timeout(Some(MAX_WAIT)).map_err(error)?;
        socket.set_write_timeout(Some(MAX_SEND)).map_err(error)?;
        let addr = socket.local_addr().map_err(error)?;
        let buf = vec![0; MAX_DATAGRAM].into_boxed_slice();
        Ok(Self {
            socket,
            addr,
            buf,
            timeout: MAX_WAIT,
        })
    }

    pub(super) fn local_addr(&self) -> SocketAddr {
        self.addr
    }

    /// Waits for a datagram, for about `wait` nanoseconds if given.
    pub(super) fn receive(&mut self, wait: Option<Nanos>) -> Result<Arrival<'_>, AgentError> {
        let wait = wait.map_or(MAX_WAIT, Duration::from_nanos).min(MAX_WAIT);
        self.set_timeout(wait)?;
        match self.socket.recv_from(&mut self.buf) {
            Ok((0, _)) => Ok(Arrival::Nothing), // a wake-up
            Ok((len, from)) => Ok(Arrival::Datagram(
                from,
                self.buf.get(..len).unwrap_or_default(),
            )),
            Err(error) if is_passing(&error) => Ok(Arrival::Nothing),
            Err(error) => Err(AgentError::new("receive at", self.addr, error)),
        }
    }

    /// Sends a datagram; returns whether the operating system took it.
    pub(super) fn send(&self, to: SocketAddr, bytes: &[u8]) -> bool {
        self.socket
            .send_to(bytes, to)
            .is_ok_and(|sent| sent == bytes.len())
    }

    /// Changes how long the socket waits, if it must: a call per datagram would cost as much as
    /// receiving it, and waking up once too early costs nothing.
    fn set_timeout(&mut self, wait: Duration) -> Result<(), AgentError> {
        if wait < self.timeout || wait > self.timeout * 4 {
            let wait = wait.max(Duration::from_micros(1)); // zero would mean for ever
            self.socket
                .set_read_timeout(Some(wait))
                .map_err(|error| AgentError::new("set a timeout at", self.addr, error))?;
            self.timeout = wait;
        }
        Ok(())
    }
}

/// Errors after which the next datagram can arrive as if nothing had been: the time is over, a
/// signal came, or a client that was sent something is gone.
fn is_passing(error: &io::Error) -> bool {
    use ErrorKind::{
        ConnectionRefused, ConnectionReset, HostUnreachable, Interrupted, NetworkUnreachable,
        TimedOut, WouldBlock,
    };
    matches!(
        error.kind(),
        WouldBlock
            | TimedOut
            | Interrupted
            | ConnectionRefused
            | ConnectionReset
            | HostUnreachable
            | NetworkUnreachable
    )
}

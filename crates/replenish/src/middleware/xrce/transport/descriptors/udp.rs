//! Datagrams: one message each.

use crate::Nanos;
use crate::middleware::xrce::transport::contract::{Received, Sent, Transport};
use alloc::boxed::Box;
use alloc::vec;
use replenish_os::PiMutex;
use replenish_xrce::udp::UdpTransport;
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};

/// UDP to one agent.
#[derive(Debug)]
pub(crate) struct Udp {
    socket: UdpTransport,
    /// Where datagrams are received, outside of the session lock. Used by one thread at a time, so
    /// that its lock is free.
    inbox: PiMutex<Box<[u8]>>,
}

impl Udp {
    pub(crate) fn new(socket: UdpTransport, mtu: u16) -> Self {
        // One byte more, so that a message that is too long is seen to be.
        let inbox = vec![0; usize::from(mtu) + 1].into();
        Self {
            socket,
            inbox: PiMutex::new(inbox),
        }
    }
}

impl Transport for Udp {
    fn send(&self, _now: Nanos, message: &[u8]) -> io::Result<Sent> {
        self.socket.send(message)
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        let mut inbox = self.inbox.lock();
        let len = loop {
            match replenish_os::receive(&self.socket, &mut inbox) {
                Ok(len) => break len,
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock => return Ok(Received::Nothing),
                    // Fates of datagrams sent earlier; each is reported once, so that this ends.
                    ErrorKind::ConnectionRefused
                    | ErrorKind::HostUnreachable
                    | ErrorKind::NetworkUnreachable
                    | ErrorKind::Interrupted => {}
                    _ => return Err(error),
                },
            }
        };
        deliver(inbox.get(..len).unwrap_or(&[]));
        Ok(Received::Something)
    }

    fn lasting_descriptor(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }

    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<BorrowedFd<'_>>)) {
        wait(Some(self.socket.as_fd()));
    }
}

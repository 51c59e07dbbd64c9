//! UDP with DTLS as a transport: one message in each record, one record in each datagram.

use crate::inbox::Messages;
use crate::seal::{DATAGRAM, Seal};
use replenish::Nanos;
use replenish::middleware::xrce::{Received, Sent, Transport};
use replenish_os::PiMutex;
use replenish_xrce::udp::UdpTransport;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};

/// UDP with DTLS to one agent.
///
/// Two locks: the session sends with its own lock held, and a message is delivered into that lock.
/// So `seal` is free again before a message is delivered.
#[derive(Debug)]
pub(crate) struct DtlsTransport {
    socket: UdpTransport,
    seal: PiMutex<Seal>,
    inbox: PiMutex<Inbox>,
}

#[derive(Debug)]
struct Inbox {
    datagram: Box<[u8]>,
    messages: Messages,
}

impl DtlsTransport {
    pub(crate) fn new(socket: UdpTransport, seal: Seal) -> Self {
        Self {
            socket,
            seal: PiMutex::new(seal),
            inbox: PiMutex::new(Inbox {
                datagram: vec![0; DATAGRAM].into(),
                messages: Messages::with_capacity(DATAGRAM),
            }),
        }
    }
}

impl Transport for DtlsTransport {
    fn send(&self, _now: Nanos, message: &[u8]) -> io::Result<Sent> {
        self.seal.lock().send(message, &self.socket)
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        let mut inbox = self.inbox.lock();
        let Inbox { datagram, messages } = &mut *inbox;
        let received = self.socket.recv(datagram)?;
        let mut seal = self.seal.lock();
        let Some(len) = received else {
            seal.tick(&self.socket);
            return Ok(Received::Nothing);
        };
        let datagram = datagram.get(..len).unwrap_or_default();
        seal.take(datagram, &self.socket, &mut |message| {
            messages.push(message);
        })?;
        let closed = seal.is_closed();
        drop(seal);
        messages.deliver(deliver);
        Ok(if closed {
            Received::Closed
        } else {
            Received::Something
        })
    }

    fn lasting_descriptor(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }

    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<BorrowedFd<'_>>)) {
        wait(Some(self.socket.as_fd()));
    }
}

impl Drop for DtlsTransport {
    fn drop(&mut self) {
        self.seal.lock().close(&self.socket);
    }
}

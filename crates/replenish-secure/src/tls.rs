//! TCP with TLS as a transport: every message after its length. Connects by itself, again and
//! again.

use crate::inbox::Messages;
use crate::status::Status;
use replenish::Nanos;
use replenish::middleware::xrce::{Received, Sent, Transport};
use replenish_os::{PiMutex, connect_tcp};
use replenish_xrce::framing::{Prefixed, prefix};
use rustls::pki_types::ServerName;
use rustls::{ClientConfig, ClientConnection};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// TCP with TLS to one agent.
///
/// Two locks, as in the DTLS transport: `link` is free again before a message is delivered.
#[derive(Debug)]
pub(crate) struct TlsTransport {
    agent: SocketAddr,
    config: Arc<ClientConfig>,
    link: PiMutex<Option<Link>>,
    inbox: PiMutex<Inbox>,
    /// There is something that the socket has not taken yet.
    blocked: AtomicBool,
    /// A connection has ended, and `receive` has not reported it yet.
    ended: AtomicBool,
    status: Arc<Status>,
}

/// A connection.
#[derive(Debug)]
struct Link {
    tcp: Arc<TcpStream>,
    tls: ClientConnection,
    /// One message waits for the end of the handshake.
    greeted: bool,
}

#[derive(Debug)]
struct Inbox {
    decoder: Prefixed<Box<[u8]>>,
    messages: Messages,
    /// The connection whose bytes the decoder has seen.
    of: Option<Arc<TcpStream>>,
}

impl TlsTransport {
    pub(crate) fn new(
        agent: SocketAddr,
        mtu: u16,
        config: ClientConfig,
        status: Arc<Status>,
    ) -> Self {
        Self {
            agent,
            config: Arc::new(config),
            link: PiMutex::new(None),
            inbox: PiMutex::new(Inbox {
                decoder: Prefixed::new(vec![0; usize::from(mtu)].into()),
                messages: Messages::with_capacity(usize::from(u16::MAX)),
                of: None,
            }),
            blocked: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            status,
        }
    }

    fn connect(&self) -> io::Result<Link> {
        let name = ServerName::from(self.agent.ip());
        let tls = ClientConnection::new(Arc::clone(&self.config), name);
        Ok(Link {
            tcp: Arc::new(connect_tcp(self.agent)?),
            tls: tls.map_err(io::Error::other)?,
            greeted: false,
        })
    }

    fn end(&self, link: &mut Option<Link>) {
        *link = None;
        self.ended.store(true, Ordering::Release);
        self.blocked.store(false, Ordering::Release);
    }

    /// Writes what is encrypted, as far as there is room.
    fn flush(&self, link: &mut Link) -> io::Result<()> {
        let mut tcp: &TcpStream = &link.tcp;
        while link.tls.wants_write() {
            match link.tls.write_tls(&mut tcp) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(_) => {}
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::NotConnected => break,
                    ErrorKind::Interrupted => {}
                    _ => return Err(error),
                },
            }
        }
        let blocked = link.tls.wants_write();
        self.blocked.store(blocked, Ordering::Release);
        Ok(())
    }

    /// Reads once, and puts what it was in the clear into `inbox`.
    fn read(&self, link: &mut Link, inbox: &mut Inbox) -> io::Result<()> {
        let Inbox {
            decoder, messages, ..
        } = inbox;
        let mut tcp: &TcpStream = &link.tcp;
        let closed = link.tls.read_tls(&mut tcp)? == 0;
        let handshake = link.tls.is_handshaking();
        if handshake && !closed {
            self.status.answered();
        }
        let processed = link.tls.process_new_packets();
        let flushed = self.flush(link);
        if let Err(error) = processed {
            self.status.failed(error.to_string());
            return Err(io::Error::other(error));
        }
        flushed?;
        if handshake && !link.tls.is_handshaking() {
            self.status.connected();
        }
        let mut piece = [0; 4096];
        loop {
            match link.tls.reader().read(&mut piece) {
                Ok(0) => return Err(ErrorKind::ConnectionReset.into()),
                Ok(len) => decoder.push(piece.get(..len).unwrap_or_default(), |message| {
                    messages.push(message);
                }),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        let end = Err(ErrorKind::ConnectionReset.into());
        if closed { end } else { Ok(()) }
    }
}

impl Transport for TlsTransport {
    fn send(&self, _now: Nanos, message: &[u8]) -> io::Result<Sent> {
        let mut link = self.link.lock();
        if link.is_none() {
            let Ok(new) = self.connect() else {
                return Ok(Sent::Unreachable);
            };
            *link = Some(new);
        }
        let Some(open) = link.as_mut() else {
            return Ok(Sent::Unreachable);
        };
        let waits = open.tls.is_handshaking() && std::mem::replace(&mut open.greeted, true);
        if waits || (!open.tls.is_handshaking() && open.tls.wants_write()) {
            return Ok(Sent::Full);
        }
        let Some(length) = prefix(message.len()) else {
            return Err(ErrorKind::InvalidInput.into());
        };
        // The connection takes all of it: it has encrypted and written what was before it.
        let written = open.tls.writer().write_all(&length);
        let written = written.and_then(|()| open.tls.writer().write_all(message));
        if written.and_then(|()| self.flush(open)).is_err() {
            self.end(&mut link);
            return Ok(Sent::Unreachable);
        }
        Ok(Sent::Yes)
    }

    fn ready_at(&self) -> Nanos {
        if self.wants_write() { Nanos::MAX } else { 0 }
    }

    fn wants_write(&self) -> bool {
        self.blocked.load(Ordering::Acquire)
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        if self.ended.swap(false, Ordering::AcqRel) {
            return Ok(Received::Closed);
        }
        let mut inbox = self.inbox.lock();
        let mut link = self.link.lock();
        let Some(open) = link.as_mut() else {
            return Ok(Received::Nothing);
        };
        if inbox
            .of
            .as_ref()
            .is_none_or(|of| !Arc::ptr_eq(of, &open.tcp))
        {
            inbox.decoder.reset();
            inbox.of = Some(Arc::clone(&open.tcp));
        }
        let flushed = if self.wants_write() {
            self.flush(open)
        } else {
            Ok(())
        };
        let read = flushed.and_then(|()| self.read(open, &mut inbox));
        let passing = |kind| {
            matches!(
                kind,
                ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::NotConnected
            )
        };
        let closed = read.as_ref().is_err_and(|error| !passing(error.kind()));
        if closed {
            self.end(&mut link);
            self.ended.store(false, Ordering::Release);
        }
        drop(link);
        inbox.messages.deliver(deliver);
        Ok(match read {
            _ if closed => Received::Closed,
            Ok(()) => Received::Something,
            Err(_) => Received::Nothing,
        })
    }

    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<BorrowedFd<'_>>)) {
        let tcp = self.link.lock().as_ref().map(|link| Arc::clone(&link.tcp));
        wait(tcp.as_ref().map(|tcp| tcp.as_fd()));
    }
}

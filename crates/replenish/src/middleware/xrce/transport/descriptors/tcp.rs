//! TCP: every message after its length. Connects by itself, again and again.

use super::outbox::Outbox;
use crate::Nanos;
use crate::middleware::xrce::transport::contract::{Received, Sent, Transport};
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec;
use core::sync::atomic::{AtomicBool, Ordering};
use replenish_os::{PiMutex, connect_tcp};
use replenish_xrce::framing::{Prefixed, prefix};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};

/// TCP to one agent.
///
/// A connection is one allocation; there is one for each time the agent was away.
#[derive(Debug)]
pub struct TcpTransport {
    agent: SocketAddr,
    stream: PiMutex<Option<Arc<TcpStream>>>,
    outbox: PiMutex<Outbox>,
    inbox: PiMutex<Inbox>,
    /// There is something in the outbox.
    blocked: AtomicBool,
    /// A connection has ended, and `receive` has not told yet.
    ended: AtomicBool,
}

#[derive(Debug)]
struct Inbox {
    decoder: Prefixed<Box<[u8]>>,
    piece: Box<[u8]>,
    /// Connection whose bytes the decoder has seen.
    of: Option<Arc<TcpStream>>,
}

impl TcpTransport {
    /// To the agent at `agent`, with messages of up to `mtu` bytes. Connects when the first one is
    /// sent.
    #[must_use]
    pub fn new(agent: SocketAddr, mtu: u16) -> Self {
        let mtu = usize::from(mtu);
        Self {
            agent,
            stream: PiMutex::new(None),
            outbox: PiMutex::new(Outbox::new(mtu + 2)),
            inbox: PiMutex::new(Inbox {
                decoder: Prefixed::new(vec![0; mtu].into()),
                piece: vec![0; 4096].into(),
                of: None,
            }),
            blocked: AtomicBool::new(false),
            ended: AtomicBool::new(false),
        }
    }

    fn current(&self) -> Option<Arc<TcpStream>> {
        self.stream.lock().clone()
    }

    /// Forgets `stream`, if it is the one in use.
    fn end(&self, stream: &Arc<TcpStream>) {
        let mut current = self.stream.lock();
        if current.as_ref().is_some_and(|c| Arc::ptr_eq(c, stream)) {
            *current = None;
            self.ended.store(true, Ordering::Release);
            self.blocked.store(false, Ordering::Release);
        }
    }

    fn drain(&self, outbox: &mut Outbox, stream: &Arc<TcpStream>) -> Sent {
        let mut writer: &TcpStream = stream;
        if outbox.drain(|bytes| writer.write(bytes)).is_err() {
            outbox.clear();
            self.end(stream);
            return Sent::Unreachable;
        }
        self.blocked.store(!outbox.is_empty(), Ordering::Release);
        Sent::Yes
    }
}

impl Transport for TcpTransport {
    fn send(&self, _now: Nanos, message: &[u8]) -> io::Result<Sent> {
        let mut outbox = self.outbox.lock();
        let stream = match self.current() {
            Some(stream) => stream,
            None => {
                outbox.clear();
                let Ok(stream) = connect_tcp(self.agent) else {
                    return Ok(Sent::Unreachable);
                };
                let stream = Arc::new(stream);
                *self.stream.lock() = Some(Arc::clone(&stream));
                stream
            }
        };
        if !outbox.is_empty() {
            return Ok(Sent::Full);
        }
        let put = outbox.put(|room| {
            let len = message.len().checked_add(2)?;
            let (head, body) = room.get_mut(..len)?.split_first_chunk_mut()?;
            *head = prefix(message.len())?;
            body.copy_from_slice(message);
            Some(len)
        });
        if put.is_none() {
            return Err(ErrorKind::InvalidInput.into());
        }
        Ok(self.drain(&mut outbox, &stream))
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
        let Some(stream) = self.current() else {
            return Ok(Received::Nothing);
        };
        if self.wants_write() {
            self.drain(&mut self.outbox.lock(), &stream);
        }
        let mut inbox = self.inbox.lock();
        let Inbox { decoder, piece, of } = &mut *inbox;
        if of.as_ref().is_none_or(|of| !Arc::ptr_eq(of, &stream)) {
            decoder.reset();
            *of = Some(Arc::clone(&stream));
        }
        let mut reader: &TcpStream = &stream;
        match reader.read(piece) {
            Ok(len @ 1..) => {
                decoder.push(piece.get(..len).unwrap_or(&[]), deliver);
                Ok(Received::Something)
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                Ok(Received::Nothing)
            }
            Ok(_) | Err(_) => {
                *of = None;
                self.end(&stream);
                self.ended.store(false, Ordering::Release);
                Ok(Received::Closed)
            }
        }
    }

    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<BorrowedFd<'_>>)) {
        let stream = self.current();
        wait(stream.as_ref().map(|stream| stream.as_fd()));
    }
}

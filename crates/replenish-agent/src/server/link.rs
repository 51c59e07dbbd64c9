//! One byte stream with clients at its other end: a connection over TCP or TLS, or a serial line.
//!
//! ```text
//!   read ──► decoder ──► messages               send ──► frame ──► outbox ──► write
//!                                                                   │ not empty: the agent holds
//!                                                                   ▼ datagrams for this link
//! ```

use super::peer::Peer;
use super::secure::TlsStream;
use crate::report::Reason;
use replenish_os::acknowledge_at_once;
use replenish_os::tty::Tty;
use replenish_xrce::Nanos;
use replenish_xrce::framing::{
    FrameStats, Prefixed, SERIAL_AGENT, Serial, prefix, serial_frame, serial_frame_len,
};
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};

/// The longest message.
const MAX_MESSAGE: usize = 65_535;

/// Bytes read in one go, so that a busy link does not keep others waiting.
const READ: usize = 4096;

/// Bytes that may wait to be written before another message: clients behind a link that is full are
/// held, so these are replies, which are few and short.
const MAX_OUTBOX: usize = 32 * 1024;

/// Bytes of memory that are kept while nothing waits to be written.
const KEPT_OUTBOX: usize = 4 * 1024;

/// Bytes of memory that a link takes at most: the decoder's, and those that wait with one message
/// more, every byte of which a serial frame may escape.
pub(super) const LINK_BYTES: usize =
    MAX_MESSAGE + MAX_OUTBOX + serial_frame_len(MAX_MESSAGE) + size_of::<Link>();

/// The link is dead.
#[derive(Debug)]
pub(super) struct Dead;

/// A link that works.
#[derive(Debug)]
pub(super) struct Link {
    io: Io,
    /// Bytes that wait to be written, from `written` on.
    outbox: Vec<u8>,
    written: usize,
    /// The agent holds datagrams for this link.
    pub(super) held: bool,
    /// Time of the last reception.
    pub(super) heard: Nanos,
    /// Time since which no client is logged in on it, as of the last look.
    pub(super) vacant_since: Nanos,
}

#[derive(Debug)]
enum Io {
    Tcp {
        stream: TcpStream,
        peer: Peer,
        decoder: Prefixed<Box<[u8]>>,
    },
    Tls {
        stream: Box<TlsStream>,
        /// The kind of a TCP peer that has not authenticated yet.
        peer: Peer,
        decoder: Prefixed<Box<[u8]>>,
    },
    Serial {
        tty: Tty,
        line: usize,
        decoder: Serial<Box<[u8]>>,
    },
}

impl Link {
    /// A connection, set to send small messages at once and never to wait.
    pub(super) fn tcp(
        stream: TcpStream,
        number: u64,
        addr: SocketAddr,
        now: Nanos,
    ) -> std::io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_nonblocking(true)?;
        let peer = Peer::Tcp { number, addr };
        let decoder = Prefixed::new(vec![0; MAX_MESSAGE].into());
        Ok(Self::new(
            Io::Tcp {
                stream,
                peer,
                decoder,
            },
            now,
        ))
    }

    /// A connection over TLS, set up in the same way.
    pub(super) fn tls(
        stream: TlsStream,
        number: u64,
        addr: SocketAddr,
        now: Nanos,
    ) -> std::io::Result<Self> {
        stream.tcp().set_nodelay(true)?;
        stream.tcp().set_nonblocking(true)?;
        Ok(Self::new(
            Io::Tls {
                stream: Box::new(stream),
                peer: Peer::Tcp { number, addr },
                decoder: Prefixed::new(vec![0; MAX_MESSAGE].into()),
            },
            now,
        ))
    }

    /// The host that is in a handshake at the other end.
    pub(super) fn shakes_hands(&self) -> Option<IpAddr> {
        match &self.io {
            Io::Tls { stream, peer, .. } => peer.host().filter(|_| stream.identity().is_none()),
            _ => None,
        }
    }

    /// The reason why the other end did not show who it is; `late` if it had no more time.
    pub(super) fn failure(&self, late: bool) -> Option<Reason> {
        match &self.io {
            Io::Tls { stream, .. } => stream.failure(late).map(Reason::Handshake),
            _ => None,
        }
    }

    /// Whether what the other end has shown is still in the access list.
    pub(super) fn is_listed(&self) -> bool {
        match &self.io {
            Io::Tls { stream, .. } => stream.is_listed(),
            _ => true,
        }
    }

    /// Serial line number `line`.
    pub(super) fn serial(tty: Tty, line: usize, now: Nanos) -> Self {
        let decoder = Serial::new(SERIAL_AGENT, vec![0; MAX_MESSAGE].into());
        Self::new(Io::Serial { tty, line, decoder }, now)
    }

    fn new(io: Io, now: Nanos) -> Self {
        Self {
            io,
            outbox: Vec::new(),
            written: 0,
            held: false,
            heard: now,
            vacant_since: now,
        }
    }

    /// The peer at the other end; address 0 stands for all peers of a serial line.
    pub(super) fn peer(&self) -> Peer {
        match &self.io {
            Io::Tcp { peer, .. } | Io::Tls { peer, .. } => *peer,
            Io::Serial { line, .. } => Peer::Serial {
                line: *line,
                address: 0,
            },
        }
    }

    /// Whether `peer` is at the other end.
    pub(super) fn leads_to(&self, to: &Peer) -> bool {
        match (&self.io, to) {
            (Io::Tcp { peer, .. } | Io::Tls { peer, .. }, to) => peer == to,
            (Io::Serial { line, .. }, Peer::Serial { line: to, .. }) => line == to,
            (Io::Serial { .. }, _) => false,
        }
    }

    /// Whether something waits to be written.
    pub(super) fn is_busy(&self) -> bool {
        let encrypted = match &self.io {
            Io::Tls { stream, .. } => stream.wants_write(),
            _ => false,
        };
        encrypted || self.written < self.outbox.len()
    }

    /// The counters of the decoder.
    pub(super) fn frames(&self) -> FrameStats {
        match &self.io {
            Io::Tcp { decoder, .. } | Io::Tls { decoder, .. } => FrameStats {
                too_long: decoder.skipped(),
                ..FrameStats::default()
            },
            Io::Serial { decoder, .. } => decoder.stats(),
        }
    }

    /// Reads up to [`READ`] bytes and hands whole messages to `deliver`.
    pub(super) fn receive(
        &mut self,
        now: Nanos,
        mut deliver: impl FnMut(Peer, &[u8]),
    ) -> Result<(), Dead> {
        if let Io::Tls {
            stream,
            peer,
            decoder,
        } = &mut self.io
        {
            let mut heard = false;
            let read = stream.read(&mut |key, bytes| {
                if let Peer::Tcp { number, addr } = *peer {
                    *peer = Peer::Tls { number, addr, key };
                }
                heard = true;
                decoder.push(bytes, |message| deliver(*peer, message));
            });
            let _late = acknowledge_at_once(stream.tcp()).is_err();
            if heard {
                self.heard = now;
            }
            return match read {
                Err(error) if !is_passing(error.kind()) => Err(Dead),
                _ => Ok(()),
            };
        }
        let mut buf = [0; READ];
        let read = match &mut self.io {
            Io::Tcp { stream, .. } => stream.read(&mut buf),
            Io::Tls { .. } => return Ok(()),
            Io::Serial { tty, .. } => tty.read(&mut buf),
        };
        let len = match read {
            Ok(0) => return Err(Dead),
            Ok(len) => len,
            Err(error) if is_passing(error.kind()) => return Ok(()),
            Err(_) => return Err(Dead),
        };
        self.heard = now;
        let bytes = buf.get(..len).unwrap_or_default();
        match &mut self.io {
            Io::Tcp {
                stream,
                peer,
                decoder,
            } => {
                // A link that does not take it is found dead by the next read.
                let _late = acknowledge_at_once(stream).is_err();
                decoder.push(bytes, |message| deliver(*peer, message));
            }
            Io::Tls { .. } => {}
            Io::Serial { line, decoder, .. } => decoder.push(bytes, |address, message| {
                deliver(
                    Peer::Serial {
                        line: *line,
                        address,
                    },
                    message,
                );
            }),
        }
        Ok(())
    }

    /// Sends a message, or as much of it as there is room for; the rest later. Returns whether it
    /// was taken.
    pub(super) fn send(&mut self, to: &Peer, message: &[u8]) -> bool {
        if self.outbox.len().saturating_sub(self.written) > MAX_OUTBOX {
            return false;
        }
        // A peer that reads a little now and then never lets it get empty.
        self.outbox.drain(..std::mem::take(&mut self.written));
        match (&self.io, to) {
            (Io::Tcp { .. } | Io::Tls { .. }, _) => {
                let Some(prefix) = prefix(message.len()) else {
                    return false;
                };
                self.outbox.reserve_exact(prefix.len() + message.len());
                self.outbox.extend(prefix);
                self.outbox.extend(message);
            }
            (Io::Serial { .. }, Peer::Serial { address, .. }) => {
                let before = self.outbox.len();
                let most = serial_frame_len(message.len());
                self.outbox.reserve_exact(most);
                self.outbox.resize(before + most, 0);
                let room = self.outbox.get_mut(before..).unwrap_or_default();
                let framed = serial_frame(SERIAL_AGENT, *address, message, room);
                self.outbox.truncate(before + framed.unwrap_or(0));
                if framed.is_err() {
                    return false;
                }
            }
            (Io::Serial { .. }, _) => return false,
        }
        // The next read of the link finds the error.
        self.flush().is_ok()
    }

    /// Writes waiting bytes, as far as there is room.
    pub(super) fn flush(&mut self) -> Result<(), Dead> {
        while let Some(rest) = self.outbox.get(self.written..).filter(|r| !r.is_empty()) {
            let written = match &mut self.io {
                Io::Tcp { stream, .. } => stream.write(rest),
                Io::Tls { stream, .. } => stream.write(rest),
                Io::Serial { tty, .. } => tty.write(rest),
            };
            match written {
                Ok(0) => return Err(Dead),
                Ok(len) => self.written += len,
                Err(error) if is_passing(error.kind()) => return Ok(()),
                Err(_) => return Err(Dead),
            }
        }
        self.outbox.clear();
        self.outbox.shrink_to(KEPT_OUTBOX);
        self.written = 0;
        match &mut self.io {
            Io::Tls { stream, .. } => stream.flush().map_err(|_| Dead),
            _ => Ok(()),
        }
    }
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.io {
            Io::Tcp { stream, .. } => stream.as_fd(),
            Io::Tls { stream, .. } => stream.as_fd(),
            Io::Serial { tty, .. } => tty.as_fd(),
        }
    }
}

fn is_passing(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    /// Before, the memory of what was written already was kept until nothing waited, which a peer
    /// that reads a little now and then puts off for ever.
    #[test]
    fn a_peer_that_reads_a_little_now_and_then_takes_no_more_memory() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let peer = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, addr) = listener.accept().unwrap();
        let mut link = Link::tcp(stream, 1, addr, 0).unwrap();
        let to = link.peer();
        let message = [0; 8000];
        while !link.is_busy() {
            assert!(link.send(&to, &message));
        }
        for _ in 0..2000 {
            // As if it took a message, and never all that waits.
            if link.outbox.len() - link.written > message.len() {
                link.written += message.len();
            }
            assert!(link.send(&to, &message) && link.is_busy());
            assert!(link.outbox.capacity() < LINK_BYTES);
        }
        drop(peer);
    }
}

//! One byte stream with clients at its other end: a TCP connection or a serial line.
//!
//! ```text
//!   read ──► decoder ──► messages               send ──► frame ──► outbox ──► write
//!                                                                   │ not empty: the agent holds
//!                                                                   ▼ datagrams for this link
//! ```

use super::peer::Peer;
use replenish_os::tty::Tty;
use replenish_xrce::Nanos;
use replenish_xrce::framing::{
    FrameStats, Prefixed, SERIAL_AGENT, Serial, prefix, serial_frame, serial_frame_len,
};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};

/// The longest message.
const MAX_MESSAGE: usize = 65_535;

/// Bytes read in one go, so that a busy link does not keep others waiting.
const READ: usize = 4096;

/// Bytes that may wait to be written: some replies besides the message that did not fit.
const MAX_OUTBOX: usize = 256 * 1024;

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
    /// When something was last received.
    pub(super) heard: Nanos,
}

#[derive(Debug)]
enum Io {
    Tcp {
        stream: TcpStream,
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
        }
    }

    /// The peer at the other end; address 0 stands for all peers of a serial line.
    pub(super) fn peer(&self) -> Peer {
        match &self.io {
            Io::Tcp { peer, .. } => *peer,
            Io::Serial { line, .. } => Peer::Serial {
                line: *line,
                address: 0,
            },
        }
    }

    /// Whether `peer` is at the other end.
    pub(super) fn leads_to(&self, to: &Peer) -> bool {
        match (&self.io, to) {
            (Io::Tcp { peer, .. }, to) => peer == to,
            (Io::Serial { line, .. }, Peer::Serial { line: to, .. }) => line == to,
            (Io::Serial { .. }, _) => false,
        }
    }

    /// Whether something waits to be written.
    pub(super) fn is_busy(&self) -> bool {
        self.written < self.outbox.len()
    }

    /// The counters of the decoder.
    pub(super) fn frames(&self) -> FrameStats {
        match &self.io {
            Io::Tcp { decoder, .. } => FrameStats {
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
        let mut buf = [0; READ];
        let read = match &mut self.io {
            Io::Tcp { stream, .. } => stream.read(&mut buf),
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
            Io::Tcp { peer, decoder, .. } => decoder.push(bytes, |message| deliver(*peer, message)),
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
        match (&self.io, to) {
            (Io::Tcp { .. }, _) => {
                let Some(prefix) = prefix(message.len()) else {
                    return false;
                };
                self.outbox.extend(prefix);
                self.outbox.extend(message);
            }
            (Io::Serial { .. }, Peer::Serial { address, .. }) => {
                let before = self.outbox.len();
                let most = serial_frame_len(message.len());
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
        self.written = 0;
        Ok(())
    }
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.io {
            Io::Tcp { stream, .. } => stream.as_fd(),
            Io::Serial { tty, .. } => tty.as_fd(),
        }
    }
}

fn is_passing(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

//! A client session on a TCP connection or on a pseudo-terminal that may be noisy.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every test binary uses its own part")]

use super::session::{Client, MS, WRITER, endpoints, session};
use replenish_os::tty::Tty;
use replenish_os::{PollFd, clock, poll};
use replenish_xrce::client::{Event, SessionState, WriteError};
use replenish_xrce::framing::{
    Prefixed, SERIAL_AGENT, Serial, prefix, serial_frame, serial_frame_len,
};
use replenish_xrce::wire::StreamId;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};

/// The carrier of a client's bytes.
pub(crate) enum Carrier {
    Tcp(TcpStream, Prefixed<Vec<u8>>),
    Serial {
        tty: Tty,
        address: u8,
        decoder: Serial<Vec<u8>>,
        noise: Noise,
    },
}

/// Damage to what a client sends and receives: one byte in this many is changed, lost or put in; 0
/// for none.
pub(crate) struct Noise {
    pub(crate) one_in: u64,
    pub(crate) random: u64,
}

impl Noise {
    fn draw(&mut self) -> u64 {
        // xorshift64*
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        self.random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut damaged = Vec::new();
        for &byte in bytes {
            if self.one_in == 0 || !self.draw().is_multiple_of(self.one_in) {
                damaged.push(byte);
                continue;
            }
            match self.draw() % 3 {
                0 => damaged.push(byte ^ (1 << (self.draw() % 8))),
                1 => {}
                _ => damaged.extend([byte, self.draw() as u8]),
            }
        }
        damaged
    }
}

impl Carrier {
    pub(crate) fn tcp(agent: SocketAddr) -> Self {
        let stream = TcpStream::connect(agent).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_nonblocking(true).unwrap();
        Self::Tcp(stream, Prefixed::new(vec![0; 65_535]))
    }

    pub(crate) fn serial(tty: Tty, address: u8, one_in: u64) -> Self {
        Self::Serial {
            tty,
            address,
            decoder: Serial::new(address, vec![0; 65_535]),
            noise: Noise {
                one_in,
                random: 0x9e37_79b9_7f4a_7c15,
            },
        }
    }

    fn send(&mut self, message: &[u8]) {
        let mut bytes = match self {
            Self::Tcp(..) => [&prefix(message.len()).unwrap(), message].concat(),
            Self::Serial { address, noise, .. } => {
                let mut frame = vec![0; serial_frame_len(message.len())];
                let len = serial_frame(*address, SERIAL_AGENT, message, &mut frame).unwrap();
                noise.damage(&frame[..len])
            }
        };
        while !bytes.is_empty() {
            let written = match self {
                Self::Tcp(stream, _) => stream.write(&bytes),
                Self::Serial { tty, .. } => tty.write(&bytes),
            };
            match written {
                Ok(len) => drop(bytes.drain(..len)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => self.wait_to_write(),
                Err(error) => panic!("{error}"),
            }
        }
    }

    fn wait_to_write(&self) {
        let deadline = Some(clock::monotonic() + 1000 * MS);
        match self {
            Self::Tcp(stream, _) => poll(&mut [PollFd::writable(stream)], deadline).unwrap(),
            Self::Serial { tty, .. } => poll(&mut [PollFd::writable(tty)], deadline).unwrap(),
        };
    }

    /// Waits for messages until `deadline`; false when the other side is gone.
    fn receive(&mut self, deadline: u64, mut deliver: impl FnMut(&[u8])) -> bool {
        let mut buf = [0; 4096];
        let read = match self {
            Self::Tcp(stream, _) => {
                poll(&mut [PollFd::readable(stream)], Some(deadline)).unwrap();
                stream.read(&mut buf)
            }
            Self::Serial { tty, .. } => {
                poll(&mut [PollFd::readable(tty)], Some(deadline)).unwrap();
                tty.read(&mut buf)
            }
        };
        let len = match read {
            Ok(len) if len > 0 => len,
            Err(error) if error.kind() == ErrorKind::WouldBlock => return true,
            _ => return false,
        };
        match self {
            Self::Tcp(_, decoder) => decoder.push(&buf[..len], deliver),
            Self::Serial { decoder, noise, .. } => {
                decoder.push(&noise.damage(&buf[..len]), |_, message| deliver(message));
            }
        }
        true
    }
}

/// A client session on a carrier.
pub(crate) struct Live {
    pub(crate) carrier: Carrier,
    pub(crate) session: Client,
    pub(crate) got: Vec<Vec<u8>>,
    pub(crate) connected: bool,
}

impl Live {
    /// A session that is up, with writer 1 of `writes` and reader 2 of `reads`.
    pub(crate) fn open(
        carrier: Carrier,
        key: u8,
        writes: &str,
        reads: &str,
        stream: StreamId,
    ) -> Self {
        let mut live = Self {
            carrier,
            session: session(key, 5_000 * MS),
            got: Vec::new(),
            connected: true,
        };
        endpoints(&mut live.session, writes, reads, stream);
        live.session.connect(clock::monotonic());
        live.until(|live| live.session.state() == SessionState::Up);
        live
    }

    pub(crate) fn until(&mut self, done: impl Fn(&Self) -> bool) {
        let deadline = clock::monotonic() + 60_000 * MS;
        while !done(self) {
            assert!(clock::monotonic() < deadline, "{:?}", self.session.state());
            self.turn(100 * MS);
        }
    }

    /// Sends what there is, waits for something for up to `nanos`, handles it.
    pub(crate) fn turn(&mut self, nanos: u64) {
        let Self {
            carrier,
            session,
            got,
            connected,
        } = self;
        let now = clock::monotonic();
        while let Some(bytes) = session.poll_transmit(now) {
            carrier.send(bytes);
        }
        let mut keep = |event: Event<'_>| {
            if let Event::Data { payload, .. } = event {
                got.push(payload.to_vec());
            }
        };
        let deadline = session
            .next_deadline()
            .map_or(now + nanos, |at| at.min(now + nanos));
        *connected = carrier.receive(deadline, |message| {
            session.handle(clock::monotonic(), message, &mut keep);
        });
        session.tick(clock::monotonic(), &mut keep);
    }

    /// Writes, as soon as there is room.
    pub(crate) fn write(&mut self, stream: StreamId, payload: &[u8]) {
        loop {
            match self.session.write(WRITER, stream, payload) {
                Ok(()) => break,
                Err(WriteError::WouldBlock | WriteError::Down) => self.turn(10 * MS),
                Err(error) => panic!("{error}"),
            }
        }
        let now = clock::monotonic();
        while let Some(bytes) = self.session.poll_transmit(now) {
            self.carrier.send(bytes);
        }
    }
}

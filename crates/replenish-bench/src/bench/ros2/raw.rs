//! Raw UDP: blocking sockets. A sample that is longer than a datagram goes in several, with a few
//! under way at a time, so that none is dropped.

use super::ping::{LONGEST, Ping};
use crate::load::{Nanos, SEC};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::mpsc::Receiver;
use std::time::Duration;

/// Bytes of a datagram.
const PIECE: usize = 60_000;
/// Datagrams that are sent before the first has come back.
const AHEAD: usize = 2;

pub(super) struct Raw {
    socket: UdpSocket,
    sample: Vec<u8>,
    buf: Vec<u8>,
}

impl Raw {
    /// The first command is the echo's port.
    pub(super) fn connect(commands: &Receiver<String>) -> Result<Self, Failure> {
        let port = commands.recv().map_err(Failure::refused)?;
        let port: u16 = port.parse().map_err(Failure::refused)?;
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::refused)?;
        socket
            .connect((Ipv4Addr::LOCALHOST, port))
            .map_err(Failure::refused)?;
        let patience = Some(Duration::from_nanos(SEC));
        socket
            .set_read_timeout(patience)
            .map_err(Failure::refused)?;
        Ok(Self {
            socket,
            sample: vec![0; LONGEST],
            buf: vec![0; PIECE + 1],
        })
    }
}

impl Ping for Raw {
    fn round_trip(
        &mut self,
        number: u64,
        bytes: usize,
        until: Nanos,
    ) -> Result<Option<Nanos>, Failure> {
        let sample = self.sample.get_mut(..bytes).unwrap_or_default();
        for piece in sample.chunks_mut(PIECE) {
            if let Some(stamp) = piece.first_chunk_mut::<8>() {
                *stamp = number.to_le_bytes();
            }
        }
        let mut pieces = sample.chunks(PIECE);
        let mut missing = pieces.len();
        for piece in pieces.by_ref().take(AHEAD) {
            self.socket.send(piece).map_err(Failure::refused)?;
        }
        while missing > 0 {
            let Ok(len) = self.socket.recv(&mut self.buf) else {
                return Ok(None);
            };
            let piece = self.buf.get(..len).unwrap_or_default();
            if piece.first_chunk::<8>() != Some(&number.to_le_bytes()) {
                continue; // of a sample that was given up
            }
            missing -= 1;
            if let Some(piece) = pieces.next() {
                self.socket.send(piece).map_err(Failure::refused)?;
            }
        }
        let now = clock::monotonic();
        Ok((now < until).then_some(now))
    }
}

pub(super) fn echo() -> Outcome {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::refused)?;
    let address = socket.local_addr().map_err(Failure::refused)?;
    println!("ready {}", address.port());
    let mut buf = vec![0; PIECE + 1];
    loop {
        let (len, from) = socket.recv_from(&mut buf).map_err(Failure::refused)?;
        let piece = buf.get(..len).unwrap_or_default();
        // A ping that has gone does not miss the answer.
        socket.send_to(piece, from).ok();
    }
}

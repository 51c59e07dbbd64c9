//! Serial lines and pseudo-terminals, with the stock framing.
//!
//! Only as much is given to the line as it sends in two milliseconds: the kernel would take
//! kilobytes, and what is in its buffer cannot be overtaken any more.

use super::outbox::Outbox;
use crate::Nanos;
use crate::middleware::xrce::transport::contract::{Received, Sent, Transport};
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use replenish_os::{PiMutex, tty::Tty};
use replenish_xrce::framing::{
    FrameStats, SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame, serial_frame_len,
};
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};

/// The most of the line's time that may be used in advance.
const AHEAD: Nanos = 2_000_000;

/// A serial line to an agent.
#[derive(Debug)]
pub struct SerialTransport {
    path: PathBuf,
    baud: u32,
    line: PiMutex<Option<Arc<Tty>>>,
    outbox: PiMutex<Outbox>,
    inbox: PiMutex<Inbox>,
    blocked: AtomicBool,
    ended: AtomicBool,
    /// When the line will have sent everything it was given.
    busy_until: AtomicU64,
}

#[derive(Debug)]
struct Inbox {
    decoder: Serial<Box<[u8]>>,
    piece: Box<[u8]>,
}

impl SerialTransport {
    /// The line at `path`, at `baud` bits per second, with messages of up to `mtu` bytes.
    ///
    /// # Errors
    /// The errors of [`Tty::open`].
    pub fn open(path: &Path, baud: u32, mtu: u16) -> io::Result<Self> {
        let (line, mtu) = (Tty::open(path, baud)?, usize::from(mtu));
        Ok(Self {
            path: path.to_path_buf(),
            baud: baud.max(1),
            line: PiMutex::new(Some(Arc::new(line))),
            outbox: PiMutex::new(Outbox::new(serial_frame_len(mtu))),
            inbox: PiMutex::new(Inbox {
                decoder: Serial::new(SERIAL_CLIENT, vec![0; mtu].into()),
                piece: vec![0; 1024].into(),
            }),
            blocked: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            busy_until: AtomicU64::new(0),
        })
    }

    /// Frames received, damaged, and so on.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        self.inbox.lock().decoder.stats()
    }

    fn current(&self) -> Option<Arc<Tty>> {
        self.line.lock().clone()
    }

    fn end(&self) {
        *self.line.lock() = None;
        self.ended.store(true, Ordering::Release);
        self.blocked.store(false, Ordering::Release);
    }

    fn drain(&self, outbox: &mut Outbox, line: &Tty) -> Sent {
        if outbox.drain(|bytes| line.write(bytes)).is_err() {
            outbox.clear();
            self.end();
            return Sent::Unreachable;
        }
        self.blocked.store(!outbox.is_empty(), Ordering::Release);
        Sent::Yes
    }

    /// Ten bits for each byte.
    fn time_for(&self, bytes: usize) -> Nanos {
        let bits = Nanos::try_from(bytes)
            .unwrap_or(Nanos::MAX)
            .saturating_mul(10);
        bits.saturating_mul(1_000_000_000) / Nanos::from(self.baud)
    }
}

impl Transport for SerialTransport {
    fn send(&self, now: Nanos, message: &[u8]) -> io::Result<Sent> {
        let mut outbox = self.outbox.lock();
        let line = match self.current() {
            Some(line) => line,
            None => {
                outbox.clear();
                let Ok(line) = Tty::open(&self.path, self.baud) else {
                    return Ok(Sent::Unreachable);
                };
                let line = Arc::new(line);
                *self.line.lock() = Some(Arc::clone(&line));
                line
            }
        };
        if !outbox.is_empty() {
            return Ok(Sent::Full);
        }
        let framed =
            outbox.put(|room| serial_frame(SERIAL_CLIENT, SERIAL_AGENT, message, room).ok());
        let Some(len) = framed else {
            return Err(ErrorKind::InvalidInput.into());
        };
        let start = self.busy_until.load(Ordering::Relaxed).max(now);
        let end = start.saturating_add(self.time_for(len));
        self.busy_until.store(end, Ordering::Relaxed);
        Ok(self.drain(&mut outbox, &line))
    }

    fn ready_at(&self) -> Nanos {
        if self.wants_write() {
            return Nanos::MAX;
        }
        let busy = self.busy_until.load(Ordering::Relaxed);
        busy.saturating_sub(AHEAD)
    }

    fn wants_write(&self) -> bool {
        self.blocked.load(Ordering::Acquire)
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        if self.ended.swap(false, Ordering::AcqRel) {
            return Ok(Received::Closed);
        }
        let Some(line) = self.current() else {
            return Ok(Received::Nothing);
        };
        if self.wants_write() {
            self.drain(&mut self.outbox.lock(), &line);
        }
        let mut inbox = self.inbox.lock();
        let Inbox { decoder, piece } = &mut *inbox;
        match line.read(piece) {
            Ok(len @ 1..) => {
                let bytes = piece.get(..len).unwrap_or(&[]);
                decoder.push(bytes, |_, message| deliver(message));
                Ok(Received::Something)
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                Ok(Received::Nothing)
            }
            Ok(_) | Err(_) => {
                self.end();
                self.ended.store(false, Ordering::Release);
                Ok(Received::Closed)
            }
        }
    }

    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<BorrowedFd<'_>>)) {
        let line = self.current();
        wait(line.as_ref().map(|line| line.as_fd()));
    }
}

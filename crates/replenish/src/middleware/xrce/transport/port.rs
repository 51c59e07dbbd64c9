//! A serial port that you drive yourself, with the stock framing: for builds without descriptors.

use super::outbox::Outbox;
use super::{Received, Sent, Transport};
use crate::Nanos;
use crate::platform::io::{self, ErrorKind};
use crate::platform::zeroed;
use crate::sync::{Arc, AtomicU64, Mutex, Ordering, Signal};
use alloc::boxed::Box;
use core::fmt;
use replenish_xrce::framing::{
    FrameStats, SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame, serial_frame_len,
};

/// How much of the line's time may be used in advance, in ns: what the port has taken cannot be
/// overtaken any more.
const AHEAD: Nanos = 2_000_000;

/// A serial port of a microcontroller. No method waits; any thread may call them, each by one
/// thread at a time.
pub trait Port: Send + Sync + 'static {
    /// Takes received bytes into `into`; how many. 0: nothing was there.
    fn read(&self, into: &mut [u8]) -> usize;

    /// Hands bytes to the line; how many of them it took. It rings the bell when it has room again.
    fn write(&self, bytes: &[u8]) -> usize;

    /// What to ring when bytes have come, and when there is room again after a `write` that took
    /// less than it was given: from an interrupt, or from a task. Called once, at set-up.
    fn attach(&self, bell: &Arc<Signal>);

    /// Bits per second. Asked once.
    fn baud(&self) -> u32;
}

/// The stock serial framing over a [`Port`].
pub struct PortTransport<P> {
    port: P,
    outbox: Mutex<Outbox>,
    inbox: Mutex<Inbox>,
    /// ns for ten bits: a division that is not made for every message.
    byte: Nanos,
    /// When the line will have sent everything it was given.
    busy_until: AtomicU64,
}

struct Inbox {
    decoder: Serial<Box<[u8]>>,
    piece: [u8; 64],
}

impl<P: Port> PortTransport<P> {
    /// Frames over `port`, with messages of up to `mtu` bytes. Allocates their two buffers.
    pub fn new(port: P, mtu: u16) -> Self {
        let mtu = usize::from(mtu);
        let byte = 10_000_000_000 / u64::from(port.baud().max(1));
        Self {
            port,
            byte,
            outbox: Mutex::new(Outbox::new(serial_frame_len(mtu))),
            inbox: Mutex::new(Inbox {
                decoder: Serial::new(SERIAL_CLIENT, zeroed(mtu)),
                piece: [0; 64],
            }),
            busy_until: AtomicU64::new(0),
        }
    }

    /// Frames received, damaged, and so on.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        self.inbox.lock().decoder.stats()
    }

    fn drain(&self, outbox: &mut Outbox) {
        // A port has no errors: what it has no room for it takes later.
        let write = |bytes: &[u8]| match self.port.write(bytes) {
            0 => Err(ErrorKind::WouldBlock.into()),
            len => Ok(len),
        };
        outbox.drain(write).ok();
    }

    /// Ten bits for each byte.
    fn time_for(&self, bytes: usize) -> Nanos {
        self.byte.saturating_mul(bytes as u64)
    }
}

impl<P: Port> Transport for PortTransport<P> {
    fn send(&self, now: Nanos, message: &[u8]) -> io::Result<Sent> {
        let mut outbox = self.outbox.lock();
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
        self.drain(&mut outbox);
        Ok(Sent::Yes)
    }

    fn ready_at(&self) -> Nanos {
        if self.wants_write() {
            return Nanos::MAX;
        }
        let busy = self.busy_until.load(Ordering::Relaxed);
        busy.saturating_sub(AHEAD)
    }

    fn wants_write(&self) -> bool {
        !self.outbox.lock().is_empty()
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        if self.wants_write() {
            self.drain(&mut self.outbox.lock());
        }
        let mut inbox = self.inbox.lock();
        let Inbox { decoder, piece } = &mut *inbox;
        let len = self.port.read(piece);
        if len == 0 {
            return Ok(Received::Nothing);
        }
        let bytes = piece.get(..len).unwrap_or(&[]);
        decoder.push(bytes, |_, message| deliver(message));
        Ok(Received::Something)
    }

    fn attach(&self, bell: &Arc<Signal>) {
        self.port.attach(bell);
    }
}

impl<P> fmt::Debug for PortTransport<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PortTransport").finish_non_exhaustive()
    }
}

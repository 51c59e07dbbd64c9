//! A serial port that you drive yourself, with the stock framing: for builds without descriptors.

use super::super::contract::{Received, Sent, Transport};
use crate::Nanos;
use crate::platform::io::{self, ErrorKind};
use crate::platform::{Static, TEXTS, make_static, zeroed};
use crate::sync::{Arc, AtomicBool, Mutex, Notify, Ordering};
use alloc::boxed::Box;
use core::fmt;
use replenish_xrce::framing::{
    FrameStats, SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame, serial_frame_len,
};
use sporadic::{latest, since};

/// How much of the line's time may be used in advance, in ns: what the port has taken cannot be
/// overtaken any more.
const AHEAD: Nanos = 2_000_000;

/// A serial port of a microcontroller. No method waits; any thread may call them, each by one
/// thread at a time.
pub trait Port: Send + Sync + 'static {
    /// Takes received bytes into `into`; how many. 0: nothing was there.
    fn read(&self, into: &mut [u8]) -> usize;

    /// Shows `take` the received bytes that lie together, which are taken then, and says whether
    /// there may be more; `None` and nothing done, as if not said otherwise, where bytes can only
    /// be [copied](Self::read).
    fn lend(&self, take: impl FnOnce(&[u8])) -> Option<Received>
    where
        Self: Sized,
    {
        drop(take);
        None
    }

    /// Hands bytes to the line; how many of them it took. It rings the bell when it has room again.
    fn write(&self, bytes: &[u8]) -> usize;

    /// The bell to ring when bytes have come, and when there is room again after a `write` that
    /// took less than it was given: from an interrupt, or from a task. Called once, at set-up.
    fn attach(&self, bell: &Arc<Notify>);

    /// Bits per second.
    fn baud(&self) -> u32;
}

/// The stock serial framing over a [`Port`].
pub struct PortTransport<P> {
    port: P,
    outbox: Mutex<Static<Outbox>>,
    /// The port has not taken all of it; written under the lock.
    waits: AtomicBool,
    inbox: Mutex<Static<Inbox>>,
    /// ns for ten bits: a division that is not made for every message.
    byte: Nanos,
}

/// The message that is on its way to the line.
struct Outbox {
    buf: Box<[u8]>,
    /// The beginning of the bytes that the port has not taken.
    start: usize,
    end: usize,
    /// When the line will have sent everything it was given.
    busy_until: Nanos,
}

impl Outbox {
    const fn is_empty(&self) -> bool {
        self.start == self.end
    }

    /// Hands over what the port takes; the rest it takes later.
    fn drain(&mut self, port: &dyn Port) {
        while let Some(rest) = self.buf.get(self.start..self.end).filter(|r| !r.is_empty())
            && let taken @ 1.. = port.write(rest)
        {
            self.start += taken;
        }
    }
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
            waits: AtomicBool::new(false),
            outbox: Mutex::new(make_static(Outbox {
                buf: zeroed(serial_frame_len(mtu)),
                start: 0,
                end: 0,
                busy_until: 0,
            })),
            inbox: Mutex::new(make_static(Inbox {
                decoder: Serial::new(SERIAL_CLIENT, zeroed(mtu)),
                piece: [0; 64],
            })),
        }
    }

    /// Frames received, damaged, and so on.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        self.inbox.lock().decoder.stats()
    }
}

impl<P: Port> Transport for PortTransport<P> {
    fn send(&self, now: Nanos, message: &[u8]) -> io::Result<Sent> {
        let mut outbox = self.outbox.lock();
        if !outbox.is_empty() {
            return Ok(Sent::Full);
        }
        let framed = serial_frame(SERIAL_CLIENT, SERIAL_AGENT, message, &mut outbox.buf);
        let Ok(len) = framed else {
            return Err(ErrorKind::InvalidInput.into());
        };
        (outbox.start, outbox.end) = (0, len);
        // At most 10 s a byte, for at most 64 KiB with their escapes: far below the end of time.
        outbox.busy_until = latest(outbox.busy_until, now) + self.byte * len as u64;
        outbox.drain(&self.port);
        self.waits.store(!outbox.is_empty(), Ordering::Relaxed);
        Ok(Sent::Yes)
    }

    fn ready_at(&self) -> Nanos {
        let outbox = self.outbox.lock();
        if outbox.is_empty() {
            since(outbox.busy_until, AHEAD)
        } else {
            Nanos::MAX
        }
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        if self.waits.load(Ordering::Relaxed) {
            let mut outbox = self.outbox.lock();
            outbox.drain(&self.port);
            self.waits.store(!outbox.is_empty(), Ordering::Relaxed);
        }
        let mut inbox = self.inbox.lock();
        let Inbox { decoder, piece }: &mut Inbox = &mut inbox;
        let lent = self
            .port
            .lend(|bytes| decoder.push(bytes, |_, message| deliver(message)));
        if let Some(received) = lent {
            return Ok(received);
        }
        let len = self.port.read(piece);
        if len == 0 {
            return Ok(Received::Nothing);
        }
        let bytes = piece.get(..len).unwrap_or(&[]);
        decoder.push(bytes, |_, message| deliver(message));
        // Bytes that come from now on ring.
        Ok(if len < piece.len() {
            Received::All
        } else {
            Received::Something
        })
    }

    fn attach(&self, bell: &Arc<Notify>) {
        self.port.attach(bell);
    }
}

impl<P> fmt::Debug for PortTransport<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if TEXTS {
            f.write_str("PortTransport")
        } else {
            Ok(())
        }
    }
}

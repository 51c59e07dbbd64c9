//! The port's transport, shared so that its statistics can be read later.

use crate::uart::Usart2;
use replenish::middleware::xrce::{PortTransport, Received, Sent, Transport, io};
use replenish_os::Arc;
use replenish_os::Notify;

/// USART2 with the stock framing; clones are the same port.
#[derive(Clone, Debug)]
pub struct SharedPort(Arc<PortTransport<Usart2>>);

/// Counts of the frames that were received.
#[derive(Clone, Copy, Debug)]
pub struct Frames {
    /// Whole and right.
    pub delivered: u64,
    /// Lost to a wrong checksum, or cut by the beginning of the next.
    pub damaged: u64,
}

impl SharedPort {
    /// Frames over `port`, with messages of up to `mtu` bytes.
    pub fn new(port: Usart2, mtu: u16) -> Self {
        Self(Arc::new(PortTransport::new(port, mtu)))
    }

    /// The counts so far.
    pub fn stats(&self) -> Frames {
        let stats = self.0.stats();
        Frames {
            delivered: stats.frames,
            damaged: stats.damaged + stats.cut + stats.too_long,
        }
    }
}

impl Transport for SharedPort {
    fn send(&self, now: u64, message: &[u8]) -> io::Result<Sent> {
        self.0.send(now, message)
    }

    fn ready_at(&self) -> u64 {
        self.0.ready_at()
    }

    fn wants_write(&self) -> bool {
        self.0.wants_write()
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        self.0.receive(deliver)
    }

    fn attach(&self, bell: &Arc<Notify>) {
        self.0.attach(bell);
    }
}

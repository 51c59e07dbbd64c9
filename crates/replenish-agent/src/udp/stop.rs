//! Ending a running agent from another thread.
//!
//! A flag, and an empty datagram to the agent's own address that ends its wait. Should that
//! datagram get lost because the socket's buffer is full, then the agent is not waiting.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Stops agents that run with it, from any thread and as often as one likes. Clones are the same
/// handle.
#[derive(Clone, Debug, Default)]
pub struct StopHandle {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    stopped: AtomicBool,
    /// Where agents wait that run with this handle.
    listening: Mutex<Vec<SocketAddr>>,
}

impl StopHandle {
    /// A handle that has not stopped anything.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Stops the agents that run with this handle, and those that are going to, for good. Does not
    /// wait for them.
    pub fn stop(&self) {
        self.shared.stopped.store(true, Ordering::SeqCst);
        for addr in self.listening().iter() {
            wake(*addr);
        }
    }

    /// Whether [`stop`](Self::stop) was called.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.shared.stopped.load(Ordering::SeqCst)
    }

    /// Says that an agent is going to wait at `addr`, until the result is dropped. The agent must
    /// look at [`is_stopped`](Self::is_stopped) after this and before it waits.
    pub(super) fn listen_at(&self, addr: SocketAddr) -> Listening<'_> {
        self.listening().push(addr);
        Listening { stop: self, addr }
    }

    fn listening(&self) -> std::sync::MutexGuard<'_, Vec<SocketAddr>> {
        self.shared
            .listening
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// An agent that waits; see [`StopHandle::listen_at`].
pub(super) struct Listening<'a> {
    stop: &'a StopHandle,
    addr: SocketAddr,
}

impl Drop for Listening<'_> {
    fn drop(&mut self) {
        self.stop.listening().retain(|addr| *addr != self.addr);
    }
}

/// Sends an empty datagram to `addr` from somewhere on this host.
fn wake(mut addr: SocketAddr) {
    if addr.ip().is_unspecified() {
        addr.set_ip(match addr {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    let from: IpAddr = match addr {
        SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    // If this fails the agent sees the flag when its longest wait is over.
    drop(UdpSocket::bind((from, 0)).and_then(|socket| socket.send_to(&[], addr)));
}

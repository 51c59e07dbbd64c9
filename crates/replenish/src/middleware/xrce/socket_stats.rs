//! Counters of an adapter's socket.

use super::transport::Sent;
use crate::platform::io;

/// The counters of an adapter's socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SocketStats {
    /// Datagrams that the socket's buffer had no room for. What was reliable in them is sent again.
    pub full: u64,
    /// Datagrams that could not be sent because the agent was not reachable.
    pub unreachable: u64,
    /// Datagrams that the system refused otherwise.
    pub failed: u64,
    /// Datagrams received that were longer than the MTU, and dropped.
    pub oversized: u64,
}

impl SocketStats {
    /// Counts a datagram that was not simply sent.
    #[cold]
    #[inline(never)]
    pub(super) fn count(&mut self, sent: &io::Result<Sent>) {
        let counter = match sent {
            Ok(Sent::Yes) => return,
            Ok(Sent::Full) => &mut self.full,
            Ok(Sent::Unreachable) => &mut self.unreachable,
            Err(_) => &mut self.failed,
        };
        *counter += 1;
    }
}

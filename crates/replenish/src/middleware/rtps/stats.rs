//! Counters of a participant.

/// Counters of a participant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RtpsStats {
    /// Datagrams that were received.
    pub received: u64,
    /// Received datagrams that were damaged or not RTPS.
    pub malformed: u64,
    /// Datagrams that were sent.
    pub sent: u64,
    /// Datagrams that the kernel did not take.
    pub unsent: u64,
    /// Datagrams that the kernel has dropped at readers' sockets, which were full.
    pub dropped: u64,
    /// Samples that were copied from the memory of their publisher, which sent no bytes of them.
    pub shared: u64,
    /// Participants, endpoints, matches and nodes of others beyond the bounds of the settings, and
    /// nodes whose names are none of ROS 2.
    pub left_out: u64,
    /// Participants of others that are known now.
    pub participants: usize,
    /// Endpoints of others that are known now.
    pub endpoints: usize,
}

impl RtpsStats {
    pub(super) const fn count(&mut self, sent: bool) {
        if sent {
            self.sent += 1;
        } else {
            self.unsent += 1;
        }
    }
}

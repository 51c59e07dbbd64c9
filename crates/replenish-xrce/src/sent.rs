//! The fate of a message that a transport was given, for all transports.

/// The fate of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// The system has taken it.
    Yes,
    /// The socket's buffer is full; the datagram is lost.
    Full,
    /// There is no way to the agent now, or no socket at its address; the datagram is lost.
    Unreachable,
}

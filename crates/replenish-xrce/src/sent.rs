//! What became of a message that a transport was given, whatever the transport.

/// What became of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// The system has taken it.
    Yes,
    /// The socket's buffer is full; the datagram is lost.
    Full,
    /// There is no way to the agent now, or nobody at its address; the datagram is lost.
    Unreachable,
}

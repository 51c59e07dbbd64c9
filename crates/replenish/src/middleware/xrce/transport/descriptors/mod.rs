//! Transports over descriptors of Linux.
//!
//! ```text
//!   udp      serial ──┬─► outbox: the message that a byte stream has not taken yet
//!            tcp ─────┘
//! ```

mod outbox;
mod serial;
mod tcp;
mod udp;

pub use serial::SerialTransport;
pub use tcp::TcpTransport;
pub(crate) use udp::Udp;

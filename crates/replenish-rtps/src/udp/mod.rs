//! Participants on UDP sockets, driven by the caller's own threads (feature `std`).
//!
//! ```text
//!   participant   UdpParticipant: one thread does everything
//!     │
//!   sockets       Sockets: opened as RTPS numbers them, for whoever drives a participant itself
//!     │
//!   config        UdpConfig, OpenError
//! ```

mod config;
mod participant;
mod sockets;

pub use config::{HOST_DATAGRAM, OpenError, UdpConfig};
pub use participant::{UdpParticipant, UdpStats};
pub use sockets::Sockets;

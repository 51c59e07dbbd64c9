//! Participants on UDP sockets, driven by the caller's own threads (feature `std`).
//!
//! ```text
//!   participant   UdpParticipant: one thread does everything
//!     │
//!   sockets       Sockets: opened as RTPS numbers them, for whoever drives a participant itself
//!     │
//!   interfaces    Interfaces: the host's addresses that are used, which may change
//!   config        UdpConfig, OpenError
//! ```

mod config;
mod interfaces;
mod participant;
mod sockets;

pub use config::{HOST_DATAGRAM, OpenError, UdpConfig};
pub use interfaces::Interfaces;
pub use participant::{UdpParticipant, UdpStats};
pub use sockets::Sockets;

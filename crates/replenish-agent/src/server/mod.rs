//! The agent on its transports: one thread that waits for all of them and for the next deadline.
//!
//! ```text
//!   spawn / run ──► wait: UDP, TCP, serial, deadline, or woken ──► receive ──► pump ──┐
//!                     ▲                                                               │
//!                     └───────────────────────────────────────────────────────────────┘
//! ```

mod agent;
mod clock;
#[cfg(feature = "dds")]
mod dds;
mod inspector;
mod link;
mod peer;
mod ports;
mod running;
mod stop;
mod udp;

pub use agent::Agent;
pub use inspector::Inspector;
pub use running::RunningAgent;
pub use stop::StopHandle;

//! The agent on its transports: one thread that waits for all of them and for the next deadline.
//!
//! ```text
//!   agent: spawn (running) or run ──► wait: UDP, TCP, serial, deadline, wake ──► receive, pump ──┐
//!                                      ▲                                                         │
//!                                      └─────────────────────────────────────────────────────────┘
//!   ports ──┬── udp    datagram sockets           stop       ends a running agent
//!           ├── link   TCP and serial lines       inspector  takes snapshots
//!           ├── arrived messages of one read     clock      its clocks
//!           ├── secure DTLS and TLS (feature `secure`); secure_ports, their place among the others
//!           ├── found  what DTLS found
//!           └── peer   addresses of clients
//!   memory: the most memory that all of it takes
//!   access: a new access list for a running agent
//!   dds: the bridge to DDS
//! ```

mod access;
mod agent;
mod arrived;
mod clock;
mod dds;
mod found;
mod inspector;
mod link;
mod memory;
mod peer;
mod ports;
mod running;
#[cfg_attr(not(feature = "secure"), path = "secure_disabled.rs")]
mod secure;
mod secure_ports;
mod stop;
mod udp;

pub use access::AccessControl;
pub use agent::Agent;
pub use inspector::Inspector;
pub use memory::MemoryBound;
pub use running::RunningAgent;
pub use stop::StopHandle;

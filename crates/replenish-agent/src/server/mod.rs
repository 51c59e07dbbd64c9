//! The agent on its transports: one thread that waits for all of them and for the next deadline.
//!
//! ```text
//!   agent: spawn (running) or run ──► wait: UDP, TCP, serial, deadline, wake ──► receive, pump ──┐
//!                                      ▲                                                         │
//!                                      └─────────────────────────────────────────────────────────┘
//!   ports ──┬── udp    datagram sockets           stop       ends a running agent
//!           ├── link   TCP and serial lines       inspector  takes snapshots
//!           └── peer   addresses of clients       clock      its clocks
//!   dds: the bridge to DDS (feature `dds`)
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

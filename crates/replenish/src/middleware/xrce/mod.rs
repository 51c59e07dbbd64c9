//! DDS-XRCE: the protocol of micro-ROS, to any XRCE agent, over UDP, TCP, a serial line or whatever
//! else a [`Transport`] can be made of.
//!
//! ```text
//!   dispatcher                                      publishers (any thread)
//!   wait: poll transport · waker · timer   no lock     lock ─ write ─ send ─ unlock
//!   take: recv  ─ lock ─ handle ─ unlock, ...            (sends never wait)
//!         lock ─ acknowledge, heartbeat, ping ─ unlock      (if any of it is due)
//! ```
//!
//! One lock with priority inheritance protects the session. It is held while bytes are encoded,
//! decoded and given to the socket, which never waits, and never while anybody waits for the
//! network. The session's next deadline is in a timer descriptor, which a publisher that makes it
//! earlier sets itself: so the dispatcher neither has to be woken for that nor to guess.
//!
//! ```text
//!   connect ─► setup ─► adapter ─────────► transport   descriptors: UDP, TCP, serial lines of Linux
//!                │         │  waiting ◄─┘              descriptors_disabled: a port of your own
//!     services ──┤         ▼
//!                └──► state · endpoints · notices · removal     act on
//!                       objects ─► registry · backlog ─► note · flags · socket_stats    plain structs
//!   below all: config · limits · errors · describe · time
//! ```

mod adapter;
mod backlog;
mod config;
#[cfg(feature = "std")]
mod connect;
mod describe;
mod endpoints;
mod errors;
mod flags;
mod limits;
#[cfg_attr(not(feature = "full"), path = "note_disabled.rs")]
mod note;
mod notices;
mod objects;
#[cfg_attr(not(feature = "full"), path = "registry_disabled.rs")]
mod registry;
#[cfg_attr(not(feature = "full"), path = "removal_disabled.rs")]
mod removal;
mod services;
mod setup;
mod socket_stats;
mod state;
mod time;
mod transport;
#[cfg_attr(not(feature = "std"), path = "waiting_disabled.rs")]
mod waiting;

pub use crate::platform::io;
pub use adapter::{Xrce, XrceStats};
pub use config::{ConnectError, XrceConfig};
pub use socket_stats::SocketStats;
pub use transport::*;

//! How samples get from the dispatcher to a worker, and how everything is told to stop.
//!
//! ```text
//!   dispatcher                        worker
//!   deliver ──► [Inbox: Ring] ──────► pop, decode
//!      │                                │
//!      └─ ring(bell), after all locks ─►│ waits on its bell
//!      ▲                                │
//!      └── wake the middleware, iff ◄───┘
//!          the reader had left the interest set
//! ```
//!
//! These files are small and use [`crate::sync`] alone: the `loom` models in `tests/` include and
//! run them as they are.

mod flag;
mod inbox;
mod ready;
mod ring;
mod sample;
mod stop;

pub(crate) use flag::Flag;
pub(crate) use inbox::{Inbox, Keep, Outcome};
pub(crate) use ready::ReadySet;
pub(crate) use ring::{Ring, Slot};
pub use sample::{RequestIdentity, SampleInfo};
pub(crate) use stop::Stop;

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
//! Every file uses [`sync`] and nothing else of the operating system, so the models in `models/` run
//! this code over `loom`'s types.
#![forbid(unsafe_code)]
#![cfg_attr(not(any(feature = "std", loom)), no_std)]

extern crate alloc;

mod command_queue;
mod doorbell;
mod flag;
mod inbox;
#[cfg(all(test, loom))]
mod models;
#[cfg(not(all(feature = "std", not(loom))))]
mod once;
mod ready_set;
mod ring;
mod sample;
mod stop;
pub mod sync;

pub use command_queue::{CommandQueue, Declined, Reservation};
pub use doorbell::{Doorbell, Wake, WakeHandle};
pub use flag::Flag;
pub use inbox::{Delivery, Inbox, Keep, Outcome};
pub use ready_set::ReadySet;
pub use ring::{Ring, Slot};
pub use sample::{RequestIdentity, SampleInfo};
pub use stop::Stop;

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
//! Every file uses [`sync`] and nothing else of the operating system. The models in `tests/` compile
//! this crate over `loom`'s types: `RUSTFLAGS="--cfg loom" cargo test -p replenish-handoff --release`.
#![forbid(unsafe_code)]
#![cfg_attr(not(loom), no_std)]

extern crate alloc;

mod flag;
mod inbox;
mod ready_set;
mod ring;
mod sample;
mod stop;
pub mod sync;

pub use flag::Flag;
pub use inbox::{Delivery, Inbox, Keep, Outcome};
pub use ready_set::ReadySet;
pub use ring::{Ring, Slot};
pub use sample::{RequestIdentity, SampleInfo};
pub use stop::Stop;

//! The way of samples from the dispatcher to a worker, and the stop of threads.
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
//! ```text
//!   command_queue   commands to one thread, and what it retires
//!   doorbell        what a worker sleeps on            │ ready_set   handles with input
//!   inbox           samples of one subscription        │ ring        its buffers   │ sample
//!   pool            messages in memory that are lent    │ shared     by publisher and readers
//!   origins         when the chains that led to a sample began
//!   flag            triggers of a guard condition      │ stop        the stop request
//!   line_queue      lines of a log, from many threads to one     │ line        as words
//!   sync            names of locks, cells and atomics  │ once        cells without std, and models
//!   models          every interleaving (`--cfg loom`)
//! ```
//!
//! Every file uses [`sync`] and nothing else of the operating system but its clock, so the models
//! in `models/` run this code over `loom`'s types.
#![forbid(unsafe_code)]
#![cfg_attr(not(any(feature = "std", loom)), no_std)]

extern crate alloc;

mod command_queue;
mod doorbell;
mod flag;
mod inbox;
mod line;
mod line_queue;
#[cfg(all(test, loom))]
mod models;
#[cfg(not(all(feature = "std", not(loom))))]
mod once;
#[cfg_attr(not(feature = "sample-info"), path = "origins_disabled.rs")]
mod origins;
mod pool;
mod ready_set;
mod ring;
mod sample;
#[cfg_attr(not(feature = "std"), path = "shared_disabled.rs")]
mod shared;
mod stop;
pub mod sync;

pub use command_queue::{CommandQueue, Declined, Reservation};
pub use doorbell::{Doorbell, Wake, WakeHandle, Woken};
pub use flag::Flag;
pub use inbox::{Delivery, DeliveryOutcome, Inbox, Keep};
pub use line::{LINE_TEXT, LINE_WORDS, LineDraft, LineHead, read_line};
pub use line_queue::{LineQueue, LineReader};
#[cfg(feature = "sample-info")]
pub use origins::published_at;
pub use origins::{MOST_CHAINS, Origins};
pub use pool::{Counted, Pool};
pub use ready_set::ReadySet;
pub use ring::{Ring, RingSlot};
pub use sample::{RequestIdentity, SampleInfo};
pub use shared::Shared;
pub use stop::Stop;

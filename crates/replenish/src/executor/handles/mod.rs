//! Handles and their callbacks.
//!
//! ```text
//!   entry: a handle in its worker's hands, treated by its options ──► group, deadline
//!     └─ handle: the interface ◄── subscription · timer · guard · server · replies
//!           │  asynchronous: one with a future ──► waker
//!           └─ callback: what the program's function sees ──► env ──► outbox
//!   own_source: samples that the worker takes itself ──► filler: into the inbox
//!   in_memory: messages of this process's publishers, brought by themselves
//!   state: what other threads see of a handle ──► departure: how it leaves
//!   one_user: what several handles of a worker call or poll, without a lock meanwhile
//! ```

pub(crate) mod asynchronous;
pub(crate) mod callback;
pub(crate) mod deadline;
#[cfg_attr(not(feature = "full"), path = "departure_disabled.rs")]
pub(crate) mod departure;
pub(crate) mod entry;
pub(crate) mod env;
pub(crate) mod filler;
pub(crate) mod group;
pub(crate) mod guard;
pub(crate) mod handle;
pub(crate) mod in_memory;
pub(crate) mod one_user;
pub(crate) mod options;
pub(crate) mod outbox;
pub(crate) mod own_source;
pub(crate) mod replies;
pub(crate) mod server;
pub(crate) mod state;
pub(crate) mod subscription;
pub(crate) mod timer;
mod waker;

//! Handles that come and go, and triggers that change, while the executor runs, from any thread.
//!
//! ```text
//!   handle: ExecutorHandle ── worker(name) ──► worker_handle ── add ──┐
//!      │ remove                                                       ├──► live ──► mailbox, route
//!      └──────────────────────────────────────────────────────────────┘     │      updates (`run`)
//!                                        registry: handles by id ◄──────────┤
//!                                        groups: who may join, who may wait ┘
//!   worker_handle ── trigger: set_trigger ──► mailbox
//!   id: what adding returns and `remove` takes
//!   peers: publishers of a handle, wait_for_publisher ──► registry
//! ```
//!
//! `change_disabled` takes this room's place in builds without feature `full`.

mod groups;
pub(crate) mod handle;
mod id;
pub(crate) mod live;
mod peers;
pub(crate) mod registry;
mod trigger;
mod worker_handle;

pub use handle::{ExecutorHandle, Removal};
pub use id::HandleId;
pub use worker_handle::WorkerHandle;

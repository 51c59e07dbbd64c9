//! Services below the executor: what a client and a server have besides their callbacks.
//!
//! ```text
//!   create: a node's clients
//!   client ── request ──► middleware ──► handles/server ──► callback ── responder ──► middleware
//!     ▲                                                                                  │
//!     └── numbers and limits ◄── handles/replies ◄───────────── reply ◄──────────────────┘
//!   call: replies that are awaited ──► calls: their places  │  block: awaited on a thread
//!   bytes: messages as bytes, for services that must not allocate      size: limits of messages
//! ```

mod block;
pub(crate) mod bytes;
pub(crate) mod call;
mod calls;
pub(crate) mod client;
mod create;
pub(crate) mod error;
pub(crate) mod responder;
pub(crate) mod size;

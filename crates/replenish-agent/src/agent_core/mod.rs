//! The agent without sockets and clocks: datagrams and time in, datagrams out.
//!
//! ```text
//!   receive ──► session? ──no──► login ───────────────────────► replies ─┐ first
//!   (state)        │ yes                                                  ▼
//!                  ▼                                                 pump (state) ──► datagrams
//!             input stream ──► requests: CREATE, READ_DATA, ..            ▲ the most urgent client,
//!                                 │ WRITE_DATA                            │ in turns
//!                                 ▼                                       │
//!                             route ──► queues of readers ──► schedule, client_queue
//!
//!   access           the clients that may log in, and a new list of them
//!   allowance        bytes for addresses that have not shown that they receive
//!   takeover         log-ins with the key of a session at another address
//!   backpressure     blocks a stream while a keep-all reader is full
//!   confirm          reports messages that have reached all their readers
//!   recovery_window  the clients that return from the previous agent
//!   notices          incompatible QoS, and services that gain or lose their server
//!   note             rejections, with the names that they are about
//!   bridging         events to, and samples from, another middleware
//!   snapshot         the state as plain data
//! ```
//!
//! Nothing here can fail: bad input is dropped, refused or answered with a status, and counted.

mod access;
mod allowance;
mod backpressure;
mod bridging;
mod client_queue;
mod confirm;
mod login;
mod note;
mod notices;
mod recovery_window;
mod requests;
mod route;
mod schedule;
mod snapshot;
mod state;
mod takeover;

pub use state::{AgentCore, Now};

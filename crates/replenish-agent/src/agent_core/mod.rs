//! The agent without sockets and clocks: datagrams and time in, datagrams out.
//!
//! ```text
//!   receive ──► session? ──no──► login: CREATE_CLIENT, ping ──────────► replies ─┐
//!                  │ yes                                                         │ first
//!                  ▼                                                             ▼
//!               input (order, fragments) ──► requests: CREATE, READ_DATA, ..    pump ──► datagrams
//!                                               │ WRITE_DATA                     ▲
//!                                               ▼                                │ the most urgent
//!                              route: topics ──► queues of readers ──► outputs ──┘ client, in turns
//! ```
//!
//! Nothing here can fail: what is wrong is dropped, refused or answered with a status, and counted.

mod backpressure;
mod bridging;
mod client_queue;
mod confirm;
mod login;
mod notices;
mod recovery_window;
mod requests;
mod route;
mod schedule;
mod snapshot;
mod state;

pub use state::{AgentCore, Now};

//! The client: one session with an agent, as a state machine without I/O.
//!
//! ```text
//!            connect()               STATUS_AGENT OK               every object answered
//!   Idle ──────────────► Connecting ─────────────────► Restoring ─────────────────────► Up
//!                         ▲      │ CREATE_CLIENT,          │ silence                     │ silence
//!                         │      │ again and again         ▼                             ▼
//!                         └──────┴───────────────────── (Event::Down, streams start anew)
//!
//!   Up, Restoring ── close() ──► Closing ── STATUS or silence ──► Idle
//! ```
//!
//! *Silence* is no valid message of the session for [`Config::silence_limit`], although pings
//! (`GET_INFO`) were sent. Every log-in uses a new session id, so that whatever is still under way
//! from the session before cannot be taken for the new one's, and only the answer to the latest
//! log-in counts, because an agent that got an earlier one too has by then replaced that session.
//!
//! What was created is kept in a [journal](Journal) and created anew, in order, after each log-in.
//!
//! # Use
//! Feed [`Session::handle`] with datagrams and [`Session::tick`] with the time; after either, and
//! after every other call, send what [`Session::poll_transmit`] gives until it gives nothing; wait
//! for a datagram until [`Session::next_deadline`].

mod config;
mod event;
mod incoming;
mod journal;
mod link;
mod outgoing;
mod session;
mod streams;

pub use config::{Buffers, Config, PingPolicy};
pub use event::{Event, RequestError, WriteError};
pub use journal::{Journal, RequestState};
pub use link::LinkStats;
pub use session::{Session, State};

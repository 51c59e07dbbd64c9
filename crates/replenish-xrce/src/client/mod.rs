//! The client: one session with an agent, as a state machine without I/O.
//!
//! ```text
//!            connect()               STATUS_AGENT OK               every object answered
//!   Idle ──────────────► Connecting ─────────────────► Restoring ─────────────────────► Up
//!                         ▲      │ CREATE_CLIENT,          │ silence                     │ silence
//!                         │      │ again and again         ▼                             ▼
//!                         └──────┴───────────────────── (Event::Down)
//!
//!   Up, Restoring ── close() ──► Closing ── STATUS or silence ──► Idle
//! ```
//!
//! *Silence* is no valid message of the session for [`PingPolicy::silence_limit`], although pings
//! (`GET_INFO`) were sent. Every log-in uses a new session id, so that whatever is still under way
//! from the session before cannot be taken for the new one's, and only the answer to the latest
//! log-in counts, because an agent that got an earlier one too has by then replaced that session.
//!
//! Samples on reliable streams that were not acknowledged when the agent was lost are sent again in
//! the new session, after its objects exist: at least once, that is; what was acknowledged is never
//! sent again. [`LinkStats`] counts both, and what had to be given up.
//!
//! Created objects are kept in a [journal](Journal) and created anew, in order, after each log-in.
//!
//! ```text
//!   session ──┬── link         log-in, ping, loss of the agent        config   settings, storage
//!   (incoming,├── journal      created objects and reads              event    events, errors
//!   outgoing) └── streams ──┬── stream_set  streams of one kind       ping     without a session
//!                           └── restore     requests before repeated samples (restore_disabled)
//! ```
//!
//! # Use
//! Feed [`Session::handle`] with datagrams and [`Session::tick`] with the time; after either, and
//! after every other call, send what [`Session::poll_transmit`] gives until it gives nothing; wait
//! for a datagram until [`Session::next_deadline`].
//!
//! ```
//! use replenish_xrce::client::{Buffers, Config, Event, ReliableBuffers, Session, SessionState};
//! use replenish_xrce::wire::ClientKey;
//!
//! const MTU: usize = 512;
//! // As many buffers as micro-ROS has: four messages each way.
//! let (mut out, mut output) = ([0; MTU], [0; 4 * MTU]);
//! let (mut input, mut fragments, mut journal) = ([0; 4 * MTU], [0; 4 * MTU], [0; 1024]);
//! let (mut restore, mut none) = ([0; MTU], []);
//! let reliable = ReliableBuffers {
//!     output: &mut output[..],
//!     large_output: &mut none[..],
//!     input: &mut input[..],
//!     fragments: &mut fragments[..],
//! };
//! let buffers = Buffers {
//!     best_effort: [&mut out[..]],
//!     reliable: [reliable],
//!     journal: &mut journal[..],
//!     restore: &mut restore[..],
//! };
//! let config = Config::new(ClientKey(*b"demo"));
//! let mut session: Session<&mut [u8], 4, 16> = Session::new(config, buffers);
//! session.connect(0);
//! let login = session.poll_transmit(0).expect("the log-in");
//! assert_eq!(login.get(8..12), Some(&b"XRCE"[..]));
//!
//! // The agent's answer: a session.
//! let answer = [0x81, 0, 0, 0, 4, 1, 11, 0, 0, 0, b'X', b'R', b'C', b'E', 1, 0, 1, 15, 0];
//! let mut up = false;
//! session.handle(1_000_000, &answer, &mut |event| up |= event == Event::Up);
//! assert!(up && session.state() == SessionState::Up);
//! ```

mod config;
mod event;
mod incoming;
mod journal;
mod link;
mod outgoing;
mod ping;
#[cfg_attr(not(feature = "delivery"), path = "restore_disabled.rs")]
mod restore;
mod session;
mod stream_set;
mod streams;

pub use config::{Buffers, Config, PingPolicy, ReliableBuffers};
pub use event::{Event, RequestError, WriteError};
pub use journal::{Journal, RequestState};
pub use link::{LinkStats, SessionState};
pub use ping::{PING_LEN, ping, pong};
pub use session::Session;

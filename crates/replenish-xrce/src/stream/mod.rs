//! Streams: sequences of messages in one direction, best effort or reliable.
//!
//! ```text
//!             push(body)                                 deliver(submessage)
//!   writer ──► OutputBestEffort ── datagram ──► InputBestEffort ──► reader    in order, with losses
//!   writer ──► OutputReliable   ── datagram ──► InputReliable   ──► reader    exactly once, in order
//!                    ▲   └─────── HEARTBEAT ───────►  │
//!                    └─────────── ACKNACK ────────────┘
//!
//!   output_reliable ──► ring ──► spill       messages until acknowledged; an oversized submessage
//!        │   └────────► carry                unacknowledged samples, for a new session
//!        └────────────► rtt                  the round trip (rtt_disabled without that feature)
//!   input_waiting ────► input_reliable       a receiver that may have no room
//!   input_reliable ───► consume              one message in order, its submessages delivered
//!   consume ──────────► reassembly           fragments
//!   push                                     errors and form of a pushed submessage
//! ```
//!
//! Client and agent use the same four machines. Their storage is any `AsRef<[u8]> + AsMut<[u8]>`
//! (an array, a slice, a box) given once; nothing is allocated. Consecutive submessages are packed
//! into one message until it is taken for sending.

mod carry;
mod consume;
mod input_best_effort;
mod input_reliable;
mod input_waiting;
mod output_best_effort;
mod output_reliable;
mod push;
mod reassembly;
mod ring;
#[cfg_attr(not(feature = "rtt"), path = "rtt_disabled.rs")]
mod rtt;
mod spill;

pub use carry::Carried;
pub use consume::InputStats;
pub use input_best_effort::{BestEffortStats, InputBestEffort};
pub use input_reliable::{AckPolicy, InputReliable};
pub use output_best_effort::OutputBestEffort;
pub use output_reliable::{OutputReliable, OutputStats, Reliability};
pub use push::{PushError, Tail};
pub use ring::MOST_FRAGMENTS;

pub use crate::wire::StreamHeader;

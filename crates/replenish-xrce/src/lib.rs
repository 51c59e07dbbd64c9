//! DDS-XRCE as sans-I/O state machines: bytes and time in, bytes and events out.
//!
//! ```text
//!   client    the client's session: log-in, objects, samples, loss of the agent
//!   stream    best-effort and reliable streams, both directions, fragments
//!   framing   messages on serial lines and TCP
//!   wire      the codec: headers of messages and submessages, all bodies, ids
//!   udp       a socket to the agent (feature `std`)    reach  whether it is there
//!   sent      the fate of a datagram, for every transport
//!   seq       sequence numbers       features  this build's features
//!   counter   counters of events     time      times and intervals
//! ```
//!
//! Sums of lengths wrap where they are positions in a buffer: no buffer is so long that a sum of a
//! few lengths would, and every position is checked where it is used. Counters and times end at
//! their greatest value.
//!
//! Only `udp` and `reach` allocate, read a clock or touch a socket; storage is the caller's. The
//! specification is OMG DDS-XRCE 1.0 (formal/20-02-01). Where eProsima's implementation differs
//! from it, this crate has the implementation's wire form, which micro-ROS speaks.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)]

#[cfg(any(test, feature = "std"))]
extern crate std;

pub mod client;
mod counter;
pub mod features;
pub mod framing;
#[cfg(all(feature = "std", unix))]
mod reach;
mod sent;
pub mod seq;
pub mod stream;
mod time;
#[cfg(all(feature = "std", unix))]
pub mod udp;
pub mod wire;

#[cfg(all(feature = "std", unix))]
pub use reach::ping_agent;
pub use sent::Sent;
pub use seq::SeqNum;
pub use time::Nanos;

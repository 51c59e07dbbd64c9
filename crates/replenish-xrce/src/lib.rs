//! DDS-XRCE as sans-I/O state machines: bytes and time in, bytes and events out.
//!
//! ```text
//!   wire     the codec: message and submessage headers, every submessage body, ids
//!   stream   best-effort and reliable streams, both directions, fragments; used by client and agent
//!   framing  messages on serial lines and TCP
//!   client   the client's session: log-in, objects, samples, loss of the agent
//!   lossy    streams over a bad link in virtual time, for tests and measurements (feature `std`)
//!   udp      a socket to the agent (feature `std`)
//! ```
//!
//! Sums of lengths wrap where they are positions in a buffer: no buffer is so long that a sum of a few
//! lengths would, and every position is checked where it is used. Counters and times end at their
//! greatest value.
//!
//! Nothing but those two allocates, reads a clock or touches a socket; storage is the caller's. The
//! specification is OMG DDS-XRCE 1.0 (formal/20-02-01); where the text and eProsima's implementation
//! differ, the implementation's wire form is what is written here, because that is what micro-ROS
//! speaks.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)]

/// What this build can do: see the features of the same names.
pub mod features {
    /// Samples may be longer than a message. Without it such samples are refused, and those that come
    /// in fragments are dropped and counted.
    pub const FRAGMENTS: bool = cfg!(feature = "fragments");
    /// Reliable samples that were not acknowledged when the agent was lost are sent again, and what
    /// the agent tells of their fate and of objects is understood. Without it they are given up and
    /// counted.
    pub const DELIVERY: bool = cfg!(feature = "delivery");
    /// The round trip is measured, and repairs and heartbeats follow it. Without it they come at the
    /// pace of [`Reliability::heartbeat_first`](crate::stream::Reliability::heartbeat_first).
    pub const RTT: bool = cfg!(feature = "rtt");
    /// Requesters and repliers. Without it they are not created.
    pub const SERVICES: bool = cfg!(feature = "services");
    /// The agent can be asked for its time and about itself.
    pub const QUERIES: bool = cfg!(feature = "queries");
}

pub mod client;
pub mod framing;
#[cfg(feature = "std")]
pub mod lossy;
mod sent;
pub mod seq;
pub mod stream;
#[cfg(all(feature = "std", unix))]
pub mod udp;
pub mod wire;

pub use sent::Sent;

pub use seq::SeqNum;

#[cfg(any(test, feature = "std"))]
extern crate std;

/// Counts one more; out of line where flash is scarce.
#[cfg_attr(not(feature = "std"), inline(never))]
pub(crate) const fn count(counter: &mut u64) {
    count_all(counter, 1);
}

/// Counts one more in place, where each message comes by.
#[inline(always)]
pub(crate) const fn tally(counter: &mut u64) {
    *counter = counter.wrapping_add(1); // 2^64 messages take centuries
}

/// Counts `more`.
#[cfg_attr(not(feature = "std"), inline(never))]
pub(crate) const fn count_all(counter: &mut u64, more: usize) {
    *counter = counter.saturating_add(more as u64);
}

/// `time` and `by` more, at most the last moment there is.
#[cfg_attr(not(feature = "std"), inline(never))]
pub(crate) const fn later(time: Nanos, by: Nanos) -> Nanos {
    time.saturating_add(by)
}

/// A time that never comes: what is compared with times is no option of one.
pub(crate) const NEVER: Nanos = Nanos::MAX;

/// A time, if it ever comes.
pub(crate) const fn ever(time: Nanos) -> Option<Nanos> {
    if time == NEVER { None } else { Some(time) }
}

/// Nanoseconds on whatever monotonic clock the caller uses; only differences matter.
pub type Nanos = u64;

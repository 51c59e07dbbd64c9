//! RTPS 2.x, the protocol of DDS and ROS 2, as sans-I/O state machines without threads.
//!
//! ```text
//!   udp           a participant on UDP sockets, driven by the caller's thread (feature `std`)
//!     │
//!   participant   discovery (SPDP, SEDP), leases, matching by quality of service, events
//!     │
//!   endpoint      writers and readers: history, heartbeats, repairs, fragments
//!     │           ros: names, types, the graph of nodes      promise: deadlines and leases
//!   wire          the codec: messages, submessages, parameter lists of discovery
//! ```
//!
//! Bytes and times in integer nanoseconds go in; datagrams, samples and events come out. Only `udp`
//! reads a clock or touches a socket; nothing makes a thread. Memory is taken when a participant or
//! an endpoint is made, as its limits say, and never again: `no_std` with `alloc`. `wire`
//! does without an allocator, and so does `ros` but for [`ros::KnownNodes`].
//!
//! The specification is OMG DDSI-RTPS 2.5 (formal/22-04-01). `docs/rtps.md` has an example, and
//! what is not there yet.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]
#![cfg_attr(
    not(feature = "shared"),
    allow(dead_code, reason = "a reader of a board fetches nothing")
)]

extern crate alloc;
#[cfg(any(test, feature = "std"))]
extern crate std;

pub mod endpoint;
pub mod participant;
pub mod promise;
pub mod ros;
#[cfg(all(feature = "std", unix))]
pub mod udp;
pub mod wire;

//! ROS 2 without an agent: the executor's dispatcher is a participant of DDS itself.
//!
//! ```text
//!   dispatcher                                          publishers (any thread)
//!   wait: epoll on waker, alarm, discovery and           lock ─ write ─ unlock
//!         the sockets of the readers of interest         lock ─ send ─ unlock, …
//!   take: receive ─ lock ─ handle ─ unlock, …              (its own writer's datagrams alone)
//!         lock ─ announce, acknowledge, repair ─ unlock, …  (if any of it is due)
//! ```
//!
//! Every reader has a socket of its own. A worker receives from those of its best-effort readers
//! (`source`), and the dispatcher polls the others whose readers have room.
//! A flood on another topic fills that topic's socket, and the kernel drops and counts the rest of
//! it before anybody spends time on it. No thread is made. One lock with priority inheritance
//! protects the participant. It is held while bytes are handled and given to a socket, never across
//! a wait.
//!
//! ```text
//!   connect ─► endpoints · services ─► adapter ─► inlets: the sockets of readers
//!     │              │                    └─────► state ─► graph · ends ─► service_end · carried
//!     └─► environment └─► new_end                 below all: config · qos · stats
//!   source: readers whose workers receive by themselves ──► nudge
//!   fetch: long samples of other publishers ──► shared: memory of one host
//!   send: the publisher's part ──► outgoing: fragments go to the kernel together
//!   watched: endpoints that a program watches      matched: peers of an endpoint
//!   housekeeping: discovery, answers and repairs ──► allowance: their CPU time
//!         └──► network: the host's addresses, which may change
//! ```

mod adapter;
mod allowance;
mod carried;
mod config;
mod connect;
mod endpoints;
mod ends;
mod environment;
mod fetch;
mod graph;
mod housekeeping;
mod inlets;
mod matched;
mod network;
mod new_end;
mod nudge;
mod outgoing;
mod qos;
mod send;
mod service_end;
mod services;
mod shared;
mod source;
mod state;
mod stats;
mod watched;

pub use adapter::Rtps;
pub use config::{DiscoveryRange, IpVersions, RtpsConfig, RtpsError};
pub use stats::RtpsStats;

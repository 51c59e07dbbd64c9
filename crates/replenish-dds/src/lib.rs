//! ROS 2 topics and services over DDS, for programs with real-time threads.
//!
//! DDS on Linux allocates, locks without priority inheritance and starts threads that inherit their
//! creator's scheduling. So one ordinary thread owns all of it here, and the rest of the program
//! exchanges bytes with that thread through bounded queues:
//!
//! ```text
//!   your thread ── open, close, write ──► queues ──► thread "dds" ──► RustDDS ──► network
//!        ▲                                             │  one participant per domain
//!        └── wake-up, take ◄──── queues ◄──────────────┘
//! ```
//!
//! ```no_run
//! use replenish_dds::{Dds, DdsConfig, Endpoint, EndpointKind, Outgoing, Qos, Topic};
//! use replenish_os::WakeFd;
//! use std::sync::Arc;
//!
//! let dds = Dds::start(&DdsConfig::default(), Arc::new(WakeFd::new()?))?;
//! let topic = Topic::new("rt/chatter", "std_msgs::msg::dds_::Int32_");
//! dds.open(1, Endpoint {
//!     domain: 0,
//!     node: None,
//!     kind: EndpointKind::Writer { topic, qos: Qos::default() },
//! })?;
//! dds.write(1, Outgoing::sample(vec![7, 0, 0, 0])); // CDR, without the encapsulation header
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What it does
//! - Samples are bytes: little-endian XCDR1 without the encapsulation header, which is added and
//!   taken away here. Types are names only.
//! - Writers, readers, and services from both sides with ROS 2's request ids in Fast DDS's and in
//!   Cyclone's form ([`ServiceMapping`]).
//! - Nodes are announced on `ros_discovery_info`, so that ROS 2's tools list them.
//! - Samples of this process do not come back to it.
//! - Every queue and table is bounded by [`DdsLimits`]; what is dropped is counted per endpoint in
//!   the [`DdsReport`].
//! - Loopback unless told otherwise ([`Interfaces`]).
//!
//! # What it does not do
//! Keyed topics, content filters, security, XCDR2, the "basic" service mapping of DDS-RPC. A topic
//! keeps its type in a domain while an endpoint uses it.
//!
//! # Structure
//! ```text
//!   handle ──► thread ──► open_endpoint ──► domain ──► graph     handle: the program's end
//!      └────► state ◄───┘       │                                graph: ros_discovery_info
//!               │               ├── calls   requests until their replies
//!               └── queues      └── header  Cyclone's form of requests
//!   returns: participants that were silent and come back     forget: RustDDS, what it has heard
//!   config, endpoint, qos, report, error: plain data       raw: samples as bytes, for RustDDS
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod calls;
mod config;
mod domain;
mod endpoint;
mod error;
mod forget;
mod graph;
mod handle;
mod header;
mod open_endpoint;
mod qos;
mod queues;
mod raw;
mod report;
mod returns;
mod state;
mod thread;

pub use config::{DdsConfig, DdsLimits, GidSize, Interfaces, MAX_DOMAIN, ServiceMapping};
pub use endpoint::{Endpoint, EndpointKind, Id, Incoming, Node, Outgoing, RequestId, Topic};
pub use error::{DdsError, OpenError};
pub use handle::Dds;
pub use qos::{Durability, History, Mismatch, Qos};
pub use replenish_os::Nanos;
pub use replenish_os::config::ConfigError;
pub use report::{DdsReport, EndpointReport, EndpointState};

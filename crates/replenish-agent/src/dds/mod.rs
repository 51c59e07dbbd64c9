//! ROS 2 topics and services over DDS, for programs with real-time threads.
//!
//! The state machines of [`replenish_rtps`] make no threads. Here one ordinary thread drives them,
//! so that neither discovery nor others' repairs cost the rest of the program anything. The program
//! exchanges bytes with that thread through bounded queues:
//!
//! ```text
//!   your thread ── open, close, write ──► queues ──► thread "dds" ──► RTPS ──► network
//!        ▲                                             │  one participant per domain
//!        └── wake-up, take ◄──── queues ◄──────────────┘
//! ```
//!
//! ```no_run
//! use replenish_agent::dds::{Dds, DdsConfig, Endpoint, EndpointKind, Outgoing, Qos, Topic};
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
//!   taken away here. Types are names, and hashes where their packages are common ones.
//! - Writers, readers, and services from both sides with ROS 2's request ids in Fast DDS's and in
//!   Cyclone's form ([`ServiceMapping`]).
//! - Nodes are announced on `ros_discovery_info`, so that ROS 2's tools list them.
//! - Samples of this process do not come back to it.
//! - Every queue and table is bounded by [`DdsLimits`]; what is dropped is counted per endpoint in
//!   the [`DdsReport`].
//! - Loopback unless told otherwise ([`Interfaces`]).
//!
//! # What it does not do
//! Keyed topics, content filters, security, XCDR2, the "basic" service mapping of DDS-RPC.
//!
//! # Structure
//! ```text
//!   handle ──► thread ──► open_endpoint ──► domain ──► graph     handle: the program's end
//!      └────► state ◄───┘       │                                graph: ros_discovery_info
//!               │               ├── forms   what belongs to which request ──► calls, header
//!               └── queues      └── calls   requests until their replies
//!   config, endpoint, qos, report, error, type_hashes: plain data
//! ```

mod calls;
mod config;
mod domain;
mod endpoint;
mod error;
mod forms;
mod graph;
mod handle;
mod header;
mod open_endpoint;
mod prepared;
mod qos;
mod queues;
mod report;
mod state;
mod thread;
mod type_hashes;

pub use config::{DdsConfig, DdsLimits, Interfaces, MAX_DOMAIN, ServiceMapping};
pub(crate) use domain::domain_bytes;
pub use endpoint::{Endpoint, EndpointKind, Id, Incoming, Node, Outgoing, RequestId, Topic};
pub use error::{DdsError, OpenError};
pub use handle::Dds;
pub(crate) use qos::endpoint_bytes;
pub use qos::{Durability, History, Mismatch, Qos};
pub use replenish_rtps::ros::GidSize;
pub use report::{DdsReport, EndpointCounts, EndpointReport, EndpointState};

//! A DDS-XRCE agent: it connects XRCE clients (microcontrollers, and Linux processes that use the
//! same protocol) with each other, and with DDS.
//!
//! ```no_run
//! use replenish_agent::{Agent, AgentConfig, StopHandle};
//!
//! let mut agent = Agent::bind(&AgentConfig::default())?;
//! println!("listening at {}", agent.local_addr());
//! agent.run(&StopHandle::new())?; // or agent.spawn()? for a thread of its own
//! # Ok::<(), replenish_agent::AgentError>(())
//! ```
//!
//! # What it does
//! - Sessions of many clients over UDP, TCP and serial lines, each with its own entities and
//!   streams; several sessions may share an address.
//! - Every kind of entity, described in binary form, by the XML that stock clients build, or by a
//!   name for which there is a profile ([`Profiles`]) or not.
//! - Every written sample goes to all readers with the same domain, topic and type whose QoS its
//!   writer serves, of any client, the writer's own included; requests go to all repliers of the
//!   service, and replies to the one request they answer.
//! - Reliability, durability (history of living writers), keep-last, keep-all with back-pressure,
//!   lifespan, deadline (missed ones are counted), time filter.
//! - Delivery control: number of samples, time, bytes per second, pace.
//! - Best-effort and reliable streams both ways, fragments on reliable ones; ping; time.
//! - Urgent topics go first ([`TopicRule`]); among equals readers and clients take turns: a
//!   backlog on one topic delays another topic by one sample, not by the backlog.
//! - All resources that clients can take are bounded by [`Limits`]; dropped input is counted in
//!   [`Stats`] and logged with its [`Reason`]; [`AgentCore::snapshot`] shows clients and their
//!   traffic. No input ends it.
//! - An [`AccessList`] says who may log in, from where, and which topics each may write and read;
//!   [`AccessControl`] replaces it while the agent runs.
//! - With the feature `secure`, DTLS 1.2 with pre-shared keys and TLS 1.3 with certificates at both
//!   ends, beside plain UDP and TCP or instead; the access list has the secrets
//!   (`AgentConfig::secure`).
//! - With the feature `dds` every writer, reader, requester and replier of a client is one of DDS
//!   too, and every participant a ROS 2 node ([`BridgeEvent`] is the seam; `AgentConfig::dds`).
//!
//! # What it does not do yet
//! Content filters (refused with `INCOMPATIBLE`).
//!
//! # Structure
//! [`AgentCore`] is the whole agent without sockets and clocks. [`Agent`] puts it on its
//! transports.
//!
//! ```text
//!   server      transports and threads        agent_core  the state machine
//!   bridge      the seam to DDS: dds          clients     sessions and streams
//!   entities    what clients create           flow        samples, rates, turns
//!   config      settings                      report      counters, snapshots, rejections
//!   error       failures to start or go on    xml         the XML of stock clients
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod agent_core;
mod bridge;
mod clients;
mod config;
pub mod dds;
mod entities;
mod error;
mod flow;
mod report;
mod server;
mod xml;

pub use agent_core::{AgentCore, Now};
pub use bridge::{
    BridgeEvent, BridgeId, BridgeKind, BridgeQos, BridgeSample, BridgeTopic, ros_topic, ros_type,
};
pub use config::DdsBridge;
pub use config::{AccessError, AccessList, AgentConfig, Limits, Profiles, SerialConfig, TopicRule};
#[cfg(feature = "secure")]
pub use config::{SecureConfig, TlsConfig};
pub use error::AgentError;
pub use replenish_os::config::ConfigError;
pub use replenish_xrce::Nanos;
pub use report::{
    BridgeSnapshot, ClientSnapshot, EntitySnapshot, HandshakeError, ReaderSnapshot, Reason,
    RecordedSample, Refusal, Rejection, Rejections, Snapshot, Stats, StreamSnapshot, Subject,
    WriterSnapshot,
};
pub use server::{AccessControl, Agent, Inspector, MemoryBound, RunningAgent, StopHandle};

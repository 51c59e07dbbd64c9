//! A DDS-XRCE agent: it connects XRCE clients (microcontrollers, and Linux processes that use the
//! same protocol) with each other, without DDS.
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
//! - Sessions of many clients over UDP, each with its own entities and streams; several sessions
//!   may share an address.
//! - Participants, topics, publishers, subscribers, data writers and data readers, described in
//!   binary form or by the XML that stock clients build.
//! - Every written sample goes to all readers with the same domain, topic and type, of any client,
//!   the writer's own included.
//! - Best-effort and reliable streams both ways, fragments on reliable ones; ping; time.
//! - Readers take turns: a backlog on one topic delays another topic by one sample, not by the
//!   backlog.
//! - Everything a client can make it hold is bounded by [`Limits`]; everything it drops is counted
//!   in [`Stats`]. No bytes end it.
//!
//! # What it does not do yet
//! Services (requesters and repliers are refused with `INCOMPATIBLE`), entities by reference to
//! names in a configuration file, delivery control other than the number of samples, content
//! filters, transient-local durability, matching of reliability between writer and reader, TCP,
//! serial lines, DDS.
//!
//! # Structure
//! [`AgentCore`] is the whole agent without sockets and clocks. [`Agent`] puts it on a UDP socket.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod agent_core;
mod client;
mod clients;
mod config;
mod entities;
mod error;
mod inlet;
mod outlet;
mod replies;
mod sample;
mod stats;
mod topics;
mod udp;
mod xml;

pub use agent_core::{AgentCore, Now};
pub use config::{AgentConfig, Limits, Nanos};
pub use error::AgentError;
pub use stats::Stats;
pub use udp::{Agent, RunningAgent, StopHandle};

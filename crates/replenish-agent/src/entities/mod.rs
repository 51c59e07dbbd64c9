//! The entities of one client: a bounded table, created and deleted by request.
//!
//! ```text
//!   participant (domain) ◄── topic (name, type)
//!        ▲                      ▲
//!        ├── publisher  ◄── data writer ── writer ─┐
//!        ├── subscriber ◄── data reader ── reader ─┤
//!        ├── requester ── writer and reader ───────┼── topics of the agent
//!        └── replier ──── reader and writer ───────┘
//! ```
//!
//! Arrows are looked up when an entity is created, and what it needs is copied: as with eProsima's
//! agents, each entity is deleted by itself, and what was created with its help stays.

mod calls;
mod create;
mod delivery;
mod describe;
mod plan;
mod qos;
mod reader;
mod records;
mod topics;
mod writer;

pub(crate) use create::{CreationContext, MAX_DEFINITION};
pub(crate) use delivery::Delivery;
pub(crate) use plan::Plan;
pub(crate) use qos::Qos;
pub(crate) use reader::{Reader, Readiness, Role};
pub(crate) use records::{Address, Entities, EntityRecord};
pub(crate) use topics::{TopicId, TopicKey, Topics};
pub(crate) use writer::Writer;

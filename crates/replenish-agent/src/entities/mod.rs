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
//! - `records` is the table, `plan` the description of an entity; `describe` makes it of XML,
//!   binary forms and references, `create` carries it out.
//! - `writer`, `reader`, `delivery` and `calls` are the halves of an entity and their state.
//! - `topics` ties writers and readers together, by `qos`.
//!
//! Arrows are looked up when an entity is created, and their data is copied: as with eProsima's
//! agents, each entity is deleted by itself, and entities created with its help stay.

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

pub(crate) use create::{CreationContext, ENTITY_OVERHEAD};
pub(crate) use delivery::Delivery;
pub(crate) use plan::Plan;
pub(crate) use qos::Qos;
pub(crate) use reader::{QUEUE_OVERHEAD, Reader, Readiness, Role};
pub(crate) use records::{Address, Entities, EntityRecord};
pub(crate) use topics::{TOPIC_BYTES, TopicId, TopicKey, Topics};
pub(crate) use writer::Writer;

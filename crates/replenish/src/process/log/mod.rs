//! The log of a context: loggers of nodes, for callbacks in real time, too.
//!
//! ```text
//!   log_info!(logger, …) ─► logger: once, throttle ─► line: formatted on the stack
//!                                                      │ no lock, no allocation
//!   console  ◄─┐                                       ▼
//!   /rosout  ◄─┴─ writer: one ordinary thread ◄── LineQueue, bounded: lines too many are counted
//!
//!   facade: the `log` crate's lines, by the name of their target ──► foreign ◄── writer
//!   core: names, publishers, levels, the queue │ loggers: a context's │ node: a node's
//!   site: places in the source │ services: levels from outside │ macros
//! ```

mod core;
mod facade;
mod foreign;
mod logger;
mod loggers;
mod macros;
mod node;
mod services;
mod site;
mod writer;

pub use logger::{LogRule, LogTo, Logger};
pub(crate) use loggers::Loggers;
pub use site::LogSite;

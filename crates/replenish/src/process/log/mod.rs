//! The log of a context: loggers of nodes, for callbacks in real time, too.
//!
//! ```text
//!   log_info!(logger, …) ─► site: once, throttle ─► line: formatted on the stack
//!                                                    │ no lock, no allocation
//!   console  ◄─┐                                     ▼
//!   /rosout  ◄─┴─ writer: one ordinary thread ◄── LineQueue, bounded: lines too many are counted
//!
//!   loggers: names and publishers │ levels │ services: levels from outside │ macros
//! ```

mod console;
mod levels;
mod line;
mod logger;
mod loggers;
mod macros;
mod services;
mod site;
mod writer;

pub use logger::{LogRule, LogTo, Logger};
pub(crate) use loggers::Loggers;
pub use site::LogSite;

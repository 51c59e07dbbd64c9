//! A program's arguments, signals, logs and ROS time: its surroundings in an operating system.
//!
//! `process_disabled.rs` takes this room's place without feature `std`.
//!
//! ```text
//!   program: Context::{with_args, args, stop_on_signals, ok} ──► args · signals
//!   context: names of nodes, topics, services; claims      ──► args · signals · presence
//!   parameter/server: values from outside                  ──► args
//!   log: Node::logger, log_info! …, /rosout             ──► args
//!   sleep: sleep, sleep_until, Node::sleep                 ──► clock
//!   events: on_event
//!   pool: Publisher::pool, messages that are lent and not copied
//!   graph: Node::graph ──► best_available: Node::best_available_{subscription, publisher}
//!   report_json: Report::to_json
//!   time: Node::{now, rate}, ros_timer, /clock             ──► clock
//!   chains: Executor::chain
//!   diagnostics: Executor::diagnostics, /diagnostics, /statistics
//! ```

mod args;
mod best_available;
mod chains;
mod clock;
mod diagnostics;
mod events;
mod graph;
mod log;
mod pool;
mod presence;
mod program;
mod report_json;
mod signals;
mod sleep;
mod time;

pub(crate) use args::{Args, NodeTime};
pub(crate) use chains::{Chains, start_chains};
pub(crate) use clock::SimClock;
pub(crate) use diagnostics::{Diagnostics, DiagnosticsChoice, FirstNode};
pub(crate) use log::Loggers;
pub(crate) use presence::Presence;
pub(crate) use replenish_args::Kind;
pub(crate) use signals::{Ends, Watched};
pub(crate) use time::follow_clock;

/// The part that users see, and import with everything else.
pub(crate) mod prelude {
    pub use super::events::QosEvent;
    pub use super::log::Logger;
    pub use super::sleep::{sleep, sleep_until};
    pub use crate::{log_debug, log_error, log_fatal, log_info, log_warn};
}

/// The part that users see.
pub(crate) mod public {
    pub use super::events::{Count, EventSource, QosEvent};
    pub use super::graph::{Graph, GraphNode, GraphService, GraphTopic};
    pub use super::log::{LogRule, LogSite, LogTo, Logger};
    pub use super::pool::{Loan, Pool};
    pub use super::sleep::{Sleep, sleep, sleep_until};
    pub use super::time::Rate;
    /// The `log` facade: `log::info!` of any library, once [`Logger::install`] was called.
    pub use ::log;
    /// The arguments of a ROS 2 program.
    pub use replenish_args as args;
}

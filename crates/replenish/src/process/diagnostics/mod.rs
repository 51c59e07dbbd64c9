//! `/diagnostics` and `/statistics`: the state of the executor, for ROS 2's tools.
//!
//! ```text
//!   Executor::diagnostics ─► choice            context ─► first_node: the node that publishes
//!   launch ─► start: publishers, thread ─► reporter ── once a second ─┬► array ───► /diagnostics
//!                                                                     │    └─ chain_status
//!                                                                     └► metrics ─► /statistics
//! ```
//!
//! An ordinary thread reads counters that the workers write anyway. No worker waits for it.

mod array;
mod chain_status;
mod choice;
mod first_node;
mod metrics;
mod option;
mod reporter;
mod start;
mod texts;

pub(crate) use choice::DiagnosticsChoice;
pub(crate) use first_node::FirstNode;
pub(crate) use start::Diagnostics;

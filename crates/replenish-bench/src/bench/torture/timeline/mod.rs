//! The kernel's scheduler trace as pieces of CPU time, each of one thread.
//!
//! `sched_switch` says who runs, at which effective priority (inheritance included), and whether
//! the thread before wanted to go on; `sched_stat_runtime` is each advance of a thread's CPU clock.
//!
//! ```text
//!   trace_text ─► reader ─► changes ─► pieces: the timeline
//! ```

mod changes;
mod pieces;
mod reader;
#[cfg(test)]
mod standstill_tests;
#[cfg(test)]
mod tests;

pub(super) use changes::PUNCTUAL;
pub(super) use pieces::{Piece, Timeline};
pub(super) use reader::Reader;

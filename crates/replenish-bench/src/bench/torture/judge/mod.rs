//! The bounds, over the timeline of one case.
//!
//! | finding | says |
//! |---|---|
//! | window | more than B and the stated latency in a window T |
//! | rate | more than B, B/T and the stated latency since some moment |
//! | share | a thread that always wanted the CPU, and could have it, got less than B/T − 0.05 % |
//! | account | the executor's account is not what the CPU clock says |
//! | trace | the timeline is not what `/proc` says: the judge is wrong |
//!
//! CPU time counts as high while the thread's effective priority is above its background
//! priority, inherited or not. For as long as the machine stood still, which the trace tells, is
//! added to the bound. A window begins where the thread cannot have had budget waiting: the CPU ran
//! something below the thread's priority, so a thread with budget would have run. A thread that was
//! kept waiting may catch up, as a periodic task may.
//!
//! ```text
//!   evidence ─► view (of one worker) ─► upper: window, rate
//!                                   ├─► share
//!                                   └─► clocks: account, trace      each a finding ─► slowness
//! ```

mod clocks;
mod evidence;
mod finding;
mod share;
mod slowness;
mod upper;
mod view;

#[cfg(test)]
mod tests;

pub(super) use evidence::{Evidence, Halt, around, foreign, stall};
pub(super) use finding::Finding;
pub(super) use slowness::slowness;
pub(super) use view::judge;

//! `replenish why`: each late callback's response taken apart, and the change that would help.
//!
//! ```text
//!   recorded: whose events, as stretches of time ─► parts: causes, to the nanosecond
//!                                                                 │
//!   run: the command, its table, its JSON ◄── advice: a change that `plan` accepts
//! ```

mod advice;
mod parts;
mod recorded;
mod run;
#[cfg(test)]
mod tests;

pub(super) use run::Args;
pub(crate) use run::run;

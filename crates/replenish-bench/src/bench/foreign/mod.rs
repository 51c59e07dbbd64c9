//! `replenish bench foreign …`: budgets of `replenish run` and `replenish adopt` for programs that
//! know nothing of them.
//!
//! ```text
//!   command ─► shares   two programs on one CPU                    the same without replenish
//!           ─► trips    genuine rclpy beside a stuck callback      alone, and without budgets
//!           ─► flood    a control loop beside a flooded middleware no flood, and without budgets
//!           ─► cost     the enforcer's time per foreign thread     per thread of ours
//!   program ─ starts foreign programs, asks them, reads their CPU time
//!   adopted ─ `replenish adopt` as a user calls it
//! ```

mod adopted;
mod command;
mod cost;
mod flood;
mod options;
mod program;
mod shares;
mod trips;

pub(crate) use command::{Foreign, run};

//! `replenish bench enforcement`: how far budgets are overrun, against a POSIX CPU timer.
//!
//! Workers that always want more than their budget share 80 % of one CPU; what each consumes at
//! high priority beyond its budget is its overrun, by its own CPU clock. Windows of the enforcer,
//! of the baseline and of a thread that makes the enforcer's system calls and decides nothing take
//! turns in the same run.
//!
//! ```text
//!   command ─► spinners ──┐   workers under the enforcer
//!           ─► baseline ──┼─► schedule   whose turn it is when
//!           ─► bare_timer ┘
//!           ─► shares         `--shares`: what hungry workers get in the long run
//! ```

mod bare_timer;
mod baseline;
mod command;
mod schedule;
mod shares;
mod spinners;

pub(crate) use command::{Args, run};

//! A runtime for rclrs that gives each worker a thread, and a CPU budget if the program says one.
//!
//! ```text
//!   runtime() ─► Runtime ─ spins: runs async tasks, waits for its workers' threads
//!                   │ ├─► crew     the threads: begun, woken, ended together
//!                   │ └─► tasks    async tasks, on the thread that spins
//!                   ▼
//!                channel ─ what rclrs calls to make a worker
//!                   └─► thread ─ one worker: its budget, its wait set, from one spin to the next
//!                          └─► payload ─ a worker's state with its name and budget
//! ```
//!
//! Budgets come from `replenish-threads`, as libreplenish's do. Waiting is `rcl_wait` alone, so it
//! works with every RMW.
#![cfg_attr(
    test,
    allow(clippy::unwrap_used, clippy::panic, reason = "tests may panic")
)]

/// The page's program, as documentation tests compile it.
#[cfg(doctest)]
#[doc = include_str!("../../docs/budgets-rclrs.md")]
mod page {}

mod channel;
mod crew;
mod payload;
mod runtime;
mod tasks;
mod thread;

pub use payload::{Budgeted, WorkerBuilder, reports, worker};
pub use replenish_threads::{
    Budget, BudgetUsage, Failure, Guarantee, Low, Params, Policy, Report, SchedClass, Why,
};
pub use runtime::{Runtime, runtime};

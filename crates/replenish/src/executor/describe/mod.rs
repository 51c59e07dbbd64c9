//! The executor, its workers and their handles as the program describes them.
//!
//! ```text
//!   executor ── worker() ──► builder: scheduling and rules of one worker
//!      │                        │
//!      │                       add, add_async: a method for each kind of handle ── factory ──► handle
//!      │                        │                                                │
//!      │                     (a worker that runs adds handles by it, too)       topic
//!      ├── unstarted: the workers, until the start
//!      └── planning: settings and results of admission (planning_disabled without feature `plan`)
//! ```

pub(crate) mod add;
mod add_async;
pub(crate) mod builder;
pub(crate) mod executor;
pub(crate) mod factory;
#[cfg_attr(not(feature = "plan"), path = "planning_disabled.rs")]
pub(crate) mod planning;
pub(crate) mod topic;
mod unstarted;

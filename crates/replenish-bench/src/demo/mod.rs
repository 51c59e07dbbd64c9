//! `replenish demo`: the paper's load on this machine, in ten seconds.
//!
//! ```text
//!   command   options, one run of the testbench
//!     └─► report   table, page, JSON
//! ```

mod command;
mod report;

pub(crate) use command::{Args, run};

//! `replenish bench torture`: random executors, judged from outside against what is guaranteed.
//!
//! The executor under test is a child process. The kernel's scheduler trace of its CPU says which
//! thread ran when, at which effective priority, and for how much CPU time; the executor's own
//! account is compared with it and never believed.
//!
//! ```text
//!   command ─► trial ─► child        the executor under test, in a process of its own
//!      │         ├────► tracefs ─► timeline   who had the CPU, from the kernel's text
//!      │         └────► judge        bounds over that timeline          ┐
//!      ├─► generator ─► case         a seed's program, as data          │ pure
//!      ├─► shrink                    the smallest case that still fails │
//!      ├─► disturbance               does it count on this machine?      │
//!      ├─► kept               a failure's evidence on disk, judged again
//!      ├─► locked_pages       the host moves no locked memory meanwhile
//!      └─► result                    violations and the worst distances ┘
//! ```

mod case;
mod child;
mod command;
mod disturbance;
mod generator;
mod judge;
mod kept;
mod locked_pages;
mod random;
mod result;
mod shrink;
mod timeline;
mod trace_text;
mod tracefs;
mod trial;

pub(crate) use command::{Args, run};

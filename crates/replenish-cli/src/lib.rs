//! The words of the `replenish` command that a robot needs, and what every word shares.
//!
//! ```text
//!   command_line   the words below, completions, manual pages, -v and -q
//!   commands    agent  plan  simulate  suggest  doctor   top  metrics  trace
//!                 │      │       │        │        │       │     │        │
//!   live          │      │       │        │        │       ▼     ▼        ▼   programs and their recordings
//!   handoff       │      │       │        │        ▼   cost of waking a thread
//!   supervised  ◄─┘      ▼       ▼        ▼            a process under an orchestrator
//!   report               files, tables, pages          options  lock  machine  signals
//!   outcome              exit codes                    print  threads  time
//! ```
//!
//! `replenish-bench` adds the laboratory's words: `demo`, `experiment`, `bench`, `ping`, `pong`.
//! This library is theirs; it is no API to build on.

// First: the others print with its macros.
#[macro_use]
#[doc(hidden)]
pub mod print;
#[macro_use]
#[doc(hidden)]
pub mod verbosity;

mod command_line;
mod commands;
mod completions;
pub mod handoff;
pub mod laboratory;
mod live;
pub mod lock;
pub mod machine;
mod manual;
pub mod options;
pub mod outcome;
pub mod report;
pub mod signals;
pub mod supervised;
pub mod threads;
pub mod time;

pub use command_line::Cli;
pub use commands::Command;

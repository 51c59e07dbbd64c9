//! The laboratory of replenish: demo, experiments, benchmarks, and the roles they need.
//!
//! ```text
//!   command_line
//!     ├─► demo ────────┐                          bench ─► load_client   costs, beside a baseline
//!     ├─► experiment ──┼─► testbench ─► roles ◄── ping, pong             the words of one role
//!     └─► bench        │   processes     │
//!                      ▼                 ▼
//!                    report            load ─► paper                     theory and simulation
//!                    figures           grid, work                        of one window
//!
//!   lossy    reliable streams over a link that loses, in virtual time
//!   nuttx    what NuttX's SCHED_SPORADIC delivers, emulated
//!   options  value ranges that several words share
//! ```
//!
//! Not published: a robot needs `replenish-cli` only, whose words are here as well.

#[macro_use]
extern crate replenish_cli; // its printing macros in the place of the standard library's

mod bench;
mod command_line;
mod demo;
mod experiment;
mod load;
mod load_client;
pub mod lossy;
pub mod nuttx;
mod options;
pub mod paper;
mod ping;
mod pong;
mod report;
mod roles;
mod testbench;

pub use command_line::Cli;

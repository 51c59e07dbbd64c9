//! `replenish bench load`: many clients with many topics on real sockets, through one agent
//! process.
//!
//! Client `i` writes its topics at the given rate and reads those of client `i - 1`, all reliable.
//! Every sample carries its number and the time at which it was due: the generator counts each
//! topic's samples as they come, so a lost, repeated or overtaken one shows, and latency includes
//! what a sample waited because the stream was full or the generator late.
//!
//! ```text
//!   generator threads (few), 64 sockets ──► agent process ──► the same sockets
//! ```
//!
//! ```text
//!   command ─► agent        the agent's process: its CPU time, memory and counters
//!           ─► generator    the clients
//!           ─► report       table, JSON, and whether it held
//!   options  of all of them
//! ```

mod agent;
mod command;
mod generator;
mod options;
mod report;

pub(crate) use command::run;
pub(crate) use options::Args;

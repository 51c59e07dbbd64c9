//! `cargo xtask board …`: builds the images of `firmware/`, runs them in QEMU and reports.
//!
//! ```text
//!   command ─► options ─► behaviour · bench · executor · experiment   images that report by themselves
//!      │                        └──────► case: cases and theory ◄──────┐
//!      ├─► messages · demo · noise · recorder · restart · round_trip ─► testbench ─► qemu ─► host
//!      │         └─► report: the board's JSON            agent and ping beside the board
//!      │         └─► files: JSON, CSV, SVG, HTML
//!      └─► size ─► memory: flash and RAM of pong and of a talker
//! ```

mod behaviour;
mod bench;
mod case;
mod command;
mod demo;
mod executor;
mod experiment;
mod files;
mod host;
mod memory;
mod messages;
mod noise;
mod options;
mod qemu;
mod recorder;
mod report;
mod restart;
mod round_trip;
mod size;
mod testbench;

pub(crate) use command::Board;

//! The whole `replenish` command: the laboratory's words beside those of a robot.

#[macro_use]
extern crate replenish_cli; // its printing macros in the place of the standard library's

mod bench;
mod command_line;
mod demo;
mod experiment;
mod load;
mod load_client;
mod options;
mod ping;
mod pong;
mod report;
mod roles;
mod testbench;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    replenish_cli::outcome::end(command_line::Cli::parse().run())
}

//! One end of a path as a process of its own: this program again, told so by hidden options.

use super::path::Path;
use super::ping::ping;
use super::{ours, raw, wire};
use replenish_cli::outcome::{Failure, Outcome};
use std::sync::mpsc::{Receiver, channel};

/// Which end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Role {
    Ping,
    Echo,
    /// Answers, with a worker for the flood beside it.
    Control,
    /// Sends the flood.
    Flood,
}

/// Runs one end until the input ends.
pub(super) fn run(path: Path, role: Role) -> Outcome {
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_default();
    let domain: u16 = domain.parse().map_err(Failure::refused)?;
    let commands = commands();
    let shared = path == Path::Executor;
    match (path, role) {
        (Path::RawUdp, Role::Ping) => ping(raw::Raw::connect(&commands)?, &commands),
        (Path::RawUdp, _) => raw::echo(),
        (Path::Wire, Role::Ping) => ping(wire::Wire::open(domain, true)?, &commands),
        (Path::Wire, _) => wire::Wire::open(domain, false)?.echo(),
        (_, Role::Ping) => ping(ours::Ours::start(domain, shared)?, &commands),
        (_, Role::Echo) => ours::echo(domain, shared),
        (_, Role::Control) => ours::control(domain, &commands),
        (_, Role::Flood) => ours::flood(domain, &commands),
    }
}

/// The lines of the input, from a thread of their own: the process ends with them.
fn commands() -> Receiver<String> {
    let (send, commands) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lines().map_while(Result::ok) {
            if send.send(line).is_err() {
                return;
            }
        }
        std::process::exit(0);
    });
    commands
}

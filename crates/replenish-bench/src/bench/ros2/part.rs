//! One end of a path as a process of its own: this program again, told so by hidden options.

use super::windows::Path;
use super::{ours, raw, wire};
use crate::load::{MS, Nanos, SEC};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use std::fmt::Write as _;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// How long a round trip may take before it counts as lost.
pub(super) const PATIENCE: Nanos = SEC;
/// Bytes of the longest sample.
pub(super) const LONGEST: usize = 2 << 20;

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

/// The end that sends first.
pub(super) trait Ping {
    /// Sends a sample of `bytes` that begins with `number`; when it has come back, `None` if it has
    /// not until `until`.
    fn round_trip(
        &mut self,
        number: u64,
        bytes: usize,
        until: Nanos,
    ) -> Result<Option<Nanos>, Failure>;

    /// Serves what has to be served while there is no window, for a moment; `false` if nothing has.
    fn idle(&mut self) -> Result<bool, Failure> {
        Ok(false)
    }
}

/// Runs one end until the input ends.
pub(super) fn run(path: Path, role: Role) -> Outcome {
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_default();
    let domain: u16 = domain.parse().map_err(Failure::refused)?;
    let commands = commands();
    match (path, role) {
        (Path::RawUdp, Role::Ping) => ping(raw::Raw::connect(&commands)?, &commands),
        (Path::RawUdp, _) => raw::echo(),
        (Path::Wire, Role::Ping) => ping(wire::Wire::open(domain, true)?, &commands),
        (Path::Wire, _) => wire::Wire::open(domain, false)?.echo(),
        (_, Role::Ping) => ping(ours::Ours::start(domain)?, &commands),
        (_, Role::Echo) => ours::echo(domain),
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

fn ping(mut ping: impl Ping, commands: &Receiver<String>) -> Outcome {
    let mut number = 0;
    loop {
        number += 1;
        let until = clock::monotonic() + 50 * MS;
        if ping.round_trip(number, 64, until)?.is_some() {
            break;
        }
        if number > 400 {
            return Err(Failure::refused("the echo is not found within 20 s"));
        }
    }
    println!("ready");
    loop {
        let line = if ping.idle()? {
            match commands.try_recv() {
                Ok(line) => line,
                Err(TryRecvError::Empty) => continue,
                Err(TryRecvError::Disconnected) => return Ok(()),
            }
        } else {
            match commands.recv() {
                Ok(line) => line,
                Err(_) => return Ok(()),
            }
        };
        let words: Vec<&str> = line.split(' ').collect();
        let [_, bytes, count, period] = words[..] else {
            return Err(Failure::refused(format!("{line:?} is no window")));
        };
        let bytes = bytes.parse::<usize>().map_err(Failure::refused)?;
        let count = count.parse().map_err(Failure::refused)?;
        let period = period.parse().map_err(Failure::refused)?;
        let line = window(&mut ping, &mut number, bytes.min(LONGEST), count, period)?;
        println!("{line}");
    }
}

fn window(
    ping: &mut impl Ping,
    number: &mut u64,
    bytes: usize,
    count: u64,
    period: Nanos,
) -> Result<String, Failure> {
    let (mut times, mut lost) = (Vec::new(), 0);
    let mut at = clock::monotonic() + period;
    for _ in 0..count {
        clock::sleep_until(at);
        *number += 1;
        let sent = clock::monotonic();
        match ping.round_trip(*number, bytes, sent + PATIENCE)? {
            Some(back) => times.push(back.saturating_sub(sent)),
            None => lost += 1,
        }
        let now = clock::monotonic();
        at += period * (now.saturating_sub(at) / period.max(1) + 1);
    }
    let mut line = format!("times {lost}");
    for time in times {
        write!(line, " {time}").map_err(Failure::refused)?;
    }
    Ok(line)
}

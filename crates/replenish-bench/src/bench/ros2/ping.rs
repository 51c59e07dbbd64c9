//! The end that sends first: its windows of round trips.

use crate::load::{MS, Nanos, SEC};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use std::fmt::Write as _;
use std::sync::mpsc::{Receiver, TryRecvError};

/// A round trip that takes longer counts as lost.
const PATIENCE: Nanos = SEC;
/// Bytes of the longest sample.
pub(super) const LONGEST: usize = 2 << 20;

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

/// Answers each window of `commands` with its round trips, until the commands end.
pub(super) fn ping(mut ping: impl Ping, commands: &Receiver<String>) -> Outcome {
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

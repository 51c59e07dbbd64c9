//! The command line of the images that talk: `image 10000 P/L/B/T@offset P key=value …`: what
//! [`crate::case`] reads, and options among it.

use crate::case::{self, Case};
use alloc::string::String;

/// The settings of a run.
#[derive(Debug)]
pub struct Options {
    /// Length and workers.
    pub case: Case,
    /// Bits per second of the line, 1200..=4000000.
    pub baud: u32,
    /// CPU time of an answer in ms, 1..=1000.
    pub burst: u64,
    /// The part of it that a worker without a budget sleeps instead, in percent, 0..=100.
    pub sleep: u64,
    /// Flips one bit in every Nth byte; 0: in none.
    pub noise: u32,
    /// Whether the clock waits for the host's answer to each tick.
    pub lockstep: bool,
    /// Messages of the topic `flood` that the host sends per tick, on top.
    pub flood: u32,
    /// Time in ms at which the host ends the agent and starts another; 0: never. Until its session
    /// is back, the clock does not wait for the host.
    pub restart: u64,
}

/// Reads them.
///
/// # Errors
/// A sentence on the part that is missing or wrong.
pub fn read(text: &str) -> Result<Options, &'static str> {
    let mut options = Options {
        case: Case {
            length: 0,
            workers: alloc::vec::Vec::new(),
        },
        baud: 921_600,
        burst: 10,
        sleep: 0,
        noise: 0,
        lockstep: true,
        flood: 0,
        restart: 0,
    };
    let mut words = String::new();
    for word in text.split_ascii_whitespace() {
        match word.split_once('=') {
            Some((key, value)) => {
                let number = value
                    .parse()
                    .map_err(|_| "the value of an option is no number")?;
                options.set(key, number)?;
            }
            None => {
                words.push_str(word);
                words.push(' ');
            }
        }
    }
    options.case = case::read(&words)?;
    Ok(options)
}

impl Options {
    fn set(&mut self, key: &str, value: u32) -> Result<(), &'static str> {
        let within = |range: core::ops::RangeInclusive<u32>, what| {
            range.contains(&value).then_some(value).ok_or(what)
        };
        match key {
            "baud" => self.baud = within(1_200..=4_000_000, "baud is 1200 to 4000000")?,
            "burst" => self.burst = within(1..=1_000, "burst is 1 to 1000 ms")?.into(),
            "sleep" => self.sleep = within(0..=100, "sleep is 0 to 100 percent")?.into(),
            "noise" => self.noise = value,
            "lockstep" => self.lockstep = value != 0,
            "flood" => self.flood = within(0..=100, "flood is 0 to 100 messages")?,
            "restart" => self.restart = value.into(),
            _ => return Err("options are baud, burst, sleep, noise, lockstep, flood, restart"),
        }
        Ok(())
    }
}

//! Windows of messages: one of each receiver in turn.

use super::receiver::{Receiver, Setting};
use super::threads::Used;
use crate::load::{MS, Nanos, SEC};
use replenish_cli::outcome::Failure;
use replenish_os::clock;

/// Ours in one thread, ours with a worker's, the raw loop that waits, and the raw loop.
const RECEIVERS: usize = 4;
/// Time in ns in which messages come to one receiver without a break, at least. Keeps far from the
/// RT throttle.
const WINDOW: Nanos = 40 * MS;
/// Messages of a window at least.
const MESSAGES: u64 = 10;
/// The pause after that, in which what is under way arrives.
const PAUSE: Nanos = 10 * MS;
/// Length of the window that the option `--windows` counts, in ns.
const UNIT: Nanos = 400 * MS;
/// A message that leaves later than this makes its window void: the machine stood still.
const GAP: Nanos = 5 * MS;

/// Figures of one window of one receiver.
#[derive(Debug)]
pub(super) struct Window {
    /// Messages sent.
    pub sent: u64,
    /// Times in ns of the messages that arrived.
    pub times: Vec<i64>,
    /// CPU time and context switches of the receiving threads.
    pub used: Used,
}

impl Window {
    pub(super) fn each(&self, total: u64) -> f64 {
        total as f64 / (self.times.len().max(1) as f64)
    }
}

/// Messages of one window.
fn messages(rate: u64) -> u64 {
    (WINDOW * rate / SEC).max(MESSAGES)
}

/// Number of windows that together take `units` units.
pub(super) fn windows(units: u64, rate: u64) -> u64 {
    (units * UNIT * rate / SEC / messages(rate)).max(units)
}

/// Measures one window of one receiver; `None` if the machine stood still.
pub(super) fn window(of: &mut dyn Receiver, rate: u64) -> Result<Option<Window>, Failure> {
    let interval = SEC / rate;
    let messages = messages(rate);
    of.received().take();
    let before = of.used()?;
    let start = clock::monotonic() + MS;
    let mut late = 0;
    for n in 0..messages {
        let at = start + n * interval;
        clock::sleep_until(at);
        late = late.max(clock::monotonic().saturating_sub(at));
        of.send(n)?;
    }
    // The pause: for as long as anything comes.
    let end = start + messages * interval + PAUSE;
    clock::sleep_until(end);
    let used = of.used()?.since(&before);
    let times = of.received().take();
    Ok((late < GAP && !times.is_empty()).then_some(Window {
        sent: messages,
        times,
        used,
    }))
}

/// A window of each.
pub(super) type Windows = [Window; RECEIVERS];

/// Windows of all in turns until enough of them count; and how many did not.
pub(super) fn turns(
    setting: Setting,
    mut all: [&mut dyn Receiver; RECEIVERS],
) -> Result<(Vec<Windows>, u64), Failure> {
    let (mut good, mut repeated) = (Vec::new(), 0);
    while (good.len() as u64) < setting.windows && repeated <= setting.windows.max(3) {
        // Back and forth, so that what drifts meets all alike.
        let back = (good.len() + repeated as usize).is_multiple_of(2);
        let mut each = [const { None }; RECEIVERS];
        for n in 0..RECEIVERS {
            let of = if back { RECEIVERS - 1 - n } else { n };
            if let (Some(receiver), Some(slot)) = (all.get_mut(of), each.get_mut(of)) {
                *slot = window(*receiver, setting.rate)?;
            }
        }
        match each {
            [Some(a), Some(b), Some(c), Some(d)] => good.push([a, b, c, d]),
            _ => repeated += 1,
        }
    }
    if good.is_empty() {
        let why = "nothing arrived, or the machine stood still in every window";
        return Err(Failure::refused(why));
    }
    Ok((good, repeated))
}

//! Ping's sender: messages at the times of the grid, or at a steady pace without one.

use super::answers::Answers;
use super::monitor::until;
use super::protocol::{Event, PingWindow};
use super::supervised::{self, SharedGrid};
use crate::load::Nanos;
use crate::load::grid::{self, Grid};
use replenish::Publisher;
use replenish::msg::std_msgs::Int32;
use replenish_cli::signals::Stop;
use replenish_os::clock;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The sender's publishers, counters and interval.
pub(crate) struct Sender {
    /// The two topics: high, low.
    pub topics: [Publisher<Int32>; 2],
    /// Answers received on each.
    pub answers: Arc<[Answers; 2]>,
    /// Messages sent on each.
    pub sent: Arc<[AtomicU64; 2]>,
    /// Messages that could not be sent.
    pub failed: Arc<AtomicU64>,
    /// The time between two messages of one topic.
    pub interval: Nanos,
}

impl Sender {
    /// Sends until `stop`: on the grid once there is one (`supervised`), else at once.
    pub(crate) fn run(&self, grid: &SharedGrid, supervised: bool, stop: &Stop) {
        loop {
            match grid.get() {
                Some(grid) => return self.windows(grid, stop),
                None if !supervised => return self.steadily(stop),
                None if stop.wait(Duration::from_millis(10)) => return,
                None => {}
            }
        }
    }

    /// Runs one window after the other and reports each.
    fn windows(&self, grid: &Grid, stop: &Stop) {
        let mut index = clock::monotonic()
            .saturating_sub(grid.epoch)
            .div_ceil(grid.cycle());
        let mut before = self.totals();
        loop {
            self.answers.iter().for_each(|a| a.open(index));
            let mut account = PingWindow {
                index,
                ..PingWindow::default()
            };
            for i in 0..grid.messages() {
                let release = grid.release(index, i);
                if !until(release, stop) {
                    return;
                }
                account.late = account.late.max(clock::monotonic().saturating_sub(release));
                let number = grid::number(index, i);
                account.sent_high += u64::from(self.send(0, number));
                account.sent_low += u64::from(self.send(1, number));
            }
            if !until(settled(grid, index), stop) {
                return;
            }
            let [high, low] = &*self.answers;
            let now = self.totals();
            (account.received_high, account.received_low) = if grid.is_continuous() {
                (now.0 - before.0, now.1 - before.1) // an answer may come many windows later
            } else {
                (high.of(index), low.of(index))
            };
            before = now;
            supervised::emit(&Event::PingWindow(account));
            index += 1;
        }
    }

    fn totals(&self) -> (u64, u64) {
        let [high, low] = &*self.answers;
        (high.total(), low.total())
    }

    /// At a steady pace; numbers count up.
    fn steadily(&self, stop: &Stop) {
        let start = clock::monotonic();
        let mut n: u64 = 0;
        while until(start.saturating_add(n.saturating_mul(self.interval)), stop) {
            let number = i32::try_from(n % u64::from(i32::MAX.unsigned_abs())).unwrap_or(0);
            self.send(0, number);
            self.send(1, number);
            n += 1;
        }
    }

    /// Sends one message on each topic, and `flood` more on the low one.
    pub(crate) fn pair(&self, number: i32, flood: u32) {
        self.send(0, number);
        for _ in 0..=flood {
            self.send(1, number);
        }
    }

    /// Sends one message; whether it went out.
    fn send(&self, topic: usize, data: i32) -> bool {
        let (Some(publisher), Some(sent)) = (self.topics.get(topic), self.sent.get(topic)) else {
            return false;
        };
        let ok = publisher.publish(&Int32 { data }).is_ok();
        if ok {
            sent.fetch_add(1, Ordering::Relaxed);
        } else {
            self.failed.fetch_add(1, Ordering::Relaxed);
        }
        ok
    }
}

/// Time at which the answers of window `index` are in: late in the pause, or, without pauses,
/// between two messages, since the report must not hold up the next one.
fn settled(grid: &Grid, index: u64) -> Nanos {
    if grid.is_continuous() {
        grid.end(index).saturating_sub(grid.interval / 2)
    } else {
        grid.end(index) + grid.pause * 3 / 4
    }
}

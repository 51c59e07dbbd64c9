//! Which windows count: pairs what ping and pong say about the same window and judges it.
//!
//! A virtual machine may stand still for milliseconds. A window in which that happened says
//! nothing about budgets, so it is offered again instead of being counted. The judgement uses
//! clocks alone, never the outcome: a window with too few answers counts as it is. The number
//! of repeats is bounded; beyond the bound every window counts, whatever the clocks say.

use crate::load::grid::Grid;
use crate::load::{MS, Nanos};
use crate::parts::protocol::{PingWindow, PongWindow};
use std::collections::BTreeMap;

/// A clock gap longer than this makes a window void.
pub(crate) const GAP: Nanos = 5 * MS;

/// Both accounts of one window.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    /// What pong measured.
    pub pong: PongWindow,
    /// What ping measured.
    pub ping: PingWindow,
}

/// Why a window does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Void {
    /// Pong's snapshot was late.
    Snapshot,
    /// Ping sent late.
    Sender,
    /// Nobody in pong used the CPU for a while, although there was work.
    CpuMissing,
}

/// Judges a window by its clocks.
pub(crate) fn judge(window: &Window, expected_busy: Nanos) -> Result<(), Void> {
    let pong = &window.pong;
    let busy = [pong.high, pong.low]
        .iter()
        .fold(pong.support_cpu, |sum, w| {
            sum.saturating_add(w.cpu_high).saturating_add(w.cpu_low)
        });
    if pong.late > GAP {
        Err(Void::Snapshot)
    } else if window.ping.late > GAP {
        Err(Void::Sender)
    } else if busy.saturating_add(GAP) < expected_busy {
        Err(Void::CpuMissing)
    } else {
        Ok(())
    }
}

/// Collects windows until enough of them count.
#[derive(Debug)]
pub(crate) struct Collector {
    wanted: usize,
    repeats_left: u64,
    expected_busy: Nanos,
    ping: BTreeMap<u64, PingWindow>,
    pong: BTreeMap<u64, PongWindow>,
    counted: Vec<Window>,
    repeated: u64,
}

impl Collector {
    /// Wants `windows` windows and offers at most `repeats` of them again.
    ///
    /// `expected_busy` is the CPU time that theory says is used in a window.
    pub(crate) fn new(windows: u64, repeats: u64, expected_busy: Nanos) -> Self {
        Self {
            wanted: usize::try_from(windows).unwrap_or(usize::MAX),
            repeats_left: repeats,
            expected_busy,
            ping: BTreeMap::new(),
            pong: BTreeMap::new(),
            counted: Vec::new(),
            repeated: 0,
        }
    }

    /// Takes ping's account of a window.
    pub(crate) fn ping(&mut self, window: PingWindow) {
        if let Some(pong) = self.pong.remove(&window.index) {
            self.add(Window { pong, ping: window });
        } else {
            self.ping.insert(window.index, window);
        }
    }

    /// Takes pong's account of a window.
    pub(crate) fn pong(&mut self, window: PongWindow) {
        if let Some(ping) = self.ping.remove(&window.index) {
            self.add(Window { pong: window, ping });
        } else {
            self.pong.insert(window.index, window);
        }
    }

    fn add(&mut self, window: Window) {
        if self.is_complete() {
            return;
        }
        if self.repeats_left > 0 && judge(&window, self.expected_busy).is_err() {
            self.repeats_left -= 1;
            self.repeated += 1;
        } else {
            self.counted.push(window);
        }
    }

    /// Whether enough windows count.
    pub(crate) fn is_complete(&self) -> bool {
        self.counted.len() >= self.wanted
    }

    /// The windows that count so far.
    pub(crate) fn counted(&self) -> &[Window] {
        &self.counted
    }

    /// Windows that were offered again.
    pub(crate) fn repeated(&self) -> u64 {
        self.repeated
    }

    /// How long the run may take, with every repeat.
    pub(crate) fn longest(&self, grid: &Grid) -> Nanos {
        let windows = u64::try_from(self.wanted).unwrap_or(u64::MAX);
        windows
            .saturating_add(self.repeats_left)
            .saturating_mul(grid.cycle())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::protocol::WorkerWindow;

    fn window(index: u64, cpu_ms: u64, ping_late: u64, pong_late: u64) -> Window {
        let high = WorkerWindow {
            cpu_high: cpu_ms * MS,
            ..WorkerWindow::default()
        };
        Window {
            pong: PongWindow {
                index,
                high,
                late: pong_late * MS,
                ..PongWindow::default()
            },
            ping: PingWindow {
                index,
                late: ping_late * MS,
                ..PingWindow::default()
            },
        }
    }

    #[test]
    fn clocks_void_a_window_and_outcomes_do_not() {
        assert_eq!(judge(&window(0, 399, 1, 1), 400 * MS), Ok(()));
        assert_eq!(judge(&window(0, 399, 6, 1), 400 * MS), Err(Void::Sender));
        assert_eq!(judge(&window(0, 399, 1, 6), 400 * MS), Err(Void::Snapshot));
        assert_eq!(
            judge(&window(0, 390, 1, 1), 400 * MS),
            Err(Void::CpuMissing)
        );
        assert_eq!(
            judge(&window(0, 390, 1, 1), 200 * MS),
            Ok(()),
            "less was asked for"
        );
    }

    #[test]
    fn repeats_are_bounded_and_counted() {
        let mut c = Collector::new(2, 1, 400 * MS);
        for index in 0..3 {
            let w = window(index, 100, 0, 0); // always void
            c.ping(w.ping);
            assert_eq!(c.is_complete(), index == 3);
            c.pong(w.pong);
        }
        assert_eq!((c.counted().len(), c.repeated()), (2, 1));
        assert!(c.is_complete());
    }

    #[test]
    fn accounts_are_paired_in_any_order() {
        let mut c = Collector::new(2, 5, 400 * MS);
        c.pong(window(1, 399, 0, 0).pong);
        c.ping(window(0, 399, 0, 0).ping);
        c.ping(window(1, 399, 0, 0).ping);
        assert_eq!(c.counted().len(), 1);
        c.pong(window(0, 399, 0, 0).pong);
        assert!(c.is_complete());
    }
}

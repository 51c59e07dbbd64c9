//! The choice of windows: pairs the reports of ping and pong about a window and judges it.
//!
//! A virtual machine may stand still for milliseconds, once or in many short pieces. A window in
//! which that happened says nothing about budgets, so it is offered again instead of being counted.
//! The judgement uses clocks alone, never the outcome: a window with too few answers counts as it
//! is. The number of repeats is bounded. Beyond the bound every window counts, and the report calls
//! a window disturbed if the clocks speak against it.

use crate::load::grid::Grid;
use crate::load::{MS, Nanos};
use crate::roles::protocol::{PingWindow, PongWindow};
use std::collections::BTreeMap;

/// A clock gap longer than this makes a window void.
pub(crate) const GAP: Nanos = 5 * MS;

/// With this much stolen a window is void: one step of the kernel's account. Most of it may have
/// been before the window; a window more costs half a second, and one that lacks 10 of 400 ms says
/// nothing.
pub(crate) const STOLEN: Nanos = 10 * MS;

/// Windows that are offered again before disturbed ones count, however few are asked for: a machine
/// may be short of CPU time for seconds.
pub(crate) const REPEATS: u64 = 20;

/// Both accounts of one window.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    /// Pong's account of the window.
    pub pong: PongWindow,
    /// Ping's account of the window.
    pub ping: PingWindow,
    /// The reason why it should not count, if it does only because no repeats were left.
    pub disturbed: Option<Void>,
}

/// Reason why a window does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Void {
    /// Pong's snapshot was late.
    SnapshotLate,
    /// Ping sent late.
    SenderLate,
    /// The hypervisor says that it took the CPU away.
    CpuStolen,
    /// No thread of pong used the CPU for a while, although there was work.
    CpuMissing,
}

/// Windows that were offered again, by the reason. The field names are in the JSON.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Repeated {
    /// The thread that takes the snapshots woke late.
    pub snapshot_late: u64,
    /// Ping sent late.
    pub sender_late: u64,
    /// The hypervisor took the measured CPU away.
    pub cpu_stolen: u64,
    /// No thread of pong had the measured CPU, although there was work.
    pub cpu_missing: u64,
}

impl Repeated {
    fn count(&mut self, why: Void) {
        *match why {
            Void::SnapshotLate => &mut self.snapshot_late,
            Void::SenderLate => &mut self.sender_late,
            Void::CpuStolen => &mut self.cpu_stolen,
            Void::CpuMissing => &mut self.cpu_missing,
        } += 1;
    }

    /// Takes those of another run in.
    pub(crate) fn add(&mut self, other: &Self) {
        self.snapshot_late += other.snapshot_late;
        self.sender_late += other.sender_late;
        self.cpu_stolen += other.cpu_stolen;
        self.cpu_missing += other.cpu_missing;
    }

    /// All of them.
    pub(crate) fn total(&self) -> u64 {
        self.snapshot_late + self.sender_late + self.cpu_stolen + self.cpu_missing
    }
}

impl std::fmt::Display for Repeated {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let reasons = [
            (self.snapshot_late, "reading late"),
            (self.sender_late, "ping late"),
            (self.cpu_stolen, "CPU stolen by the hypervisor"),
            (self.cpu_missing, "CPU with nobody of ours"),
        ];
        let told = reasons.iter().filter(|(n, _)| *n > 0);
        let told: Vec<_> = told.map(|(n, why)| format!("{why}: {n}")).collect();
        f.write_str(&told.join(", "))
    }
}

/// Judges a window by its clocks.
pub(crate) fn judge(
    pong: &PongWindow,
    ping: &PingWindow,
    expected_busy: Nanos,
) -> Result<(), Void> {
    let busy = [pong.high, pong.low]
        .iter()
        .fold(pong.support_cpu, |sum, w| {
            sum.saturating_add(w.cpu_high).saturating_add(w.cpu_low)
        });
    if pong.late > GAP {
        Err(Void::SnapshotLate)
    } else if ping.late > GAP {
        Err(Void::SenderLate)
    } else if pong.stolen >= STOLEN {
        Err(Void::CpuStolen)
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
    repeated: Repeated,
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
            repeated: Repeated::default(),
        }
    }

    /// Takes ping's account of a window.
    pub(crate) fn ping(&mut self, window: PingWindow) {
        if let Some(pong) = self.pong.remove(&window.index) {
            self.add(pong, window);
        } else {
            self.ping.insert(window.index, window);
        }
    }

    /// Takes pong's account of a window.
    pub(crate) fn pong(&mut self, window: PongWindow) {
        if let Some(ping) = self.ping.remove(&window.index) {
            self.add(window, ping);
        } else {
            self.pong.insert(window.index, window);
        }
    }

    fn add(&mut self, pong: PongWindow, ping: PingWindow) {
        if self.is_complete() {
            return;
        }
        match judge(&pong, &ping, self.expected_busy).err() {
            Some(why) if self.repeats_left > 0 => {
                self.repeats_left -= 1;
                self.repeated.count(why);
            }
            disturbed => self.counted.push(Window {
                pong,
                ping,
                disturbed,
            }),
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
    pub(crate) fn repeated(&self) -> Repeated {
        self.repeated
    }

    /// The longest duration of the run in ns, with every repeat.
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
    use crate::roles::protocol::WorkerWindow;

    fn pong(index: u64, cpu_ms: u64, late: u64, stolen: u64) -> PongWindow {
        PongWindow {
            index,
            high: WorkerWindow {
                cpu_high: cpu_ms * MS,
                ..WorkerWindow::default()
            },
            late: late * MS,
            stolen: stolen * MS,
            ..PongWindow::default()
        }
    }

    fn ping(index: u64, late: u64) -> PingWindow {
        PingWindow {
            index,
            late: late * MS,
            ..PingWindow::default()
        }
    }

    /// The judgement of a window with these values: CPU time used, lateness of both, stolen,
    /// expected.
    fn judged(cpu: u64, ping_late: u64, late: u64, stolen: u64, busy: u64) -> Result<(), Void> {
        judge(&pong(0, cpu, late, stolen), &ping(0, ping_late), busy * MS)
    }

    #[test]
    fn clocks_void_a_window_and_outcomes_do_not() {
        assert_eq!(judged(399, 1, 1, 0, 400), Ok(()));
        assert_eq!(judged(399, 6, 1, 0, 400), Err(Void::SenderLate));
        assert_eq!(judged(399, 1, 6, 0, 400), Err(Void::SnapshotLate));
        assert_eq!(judged(390, 1, 1, 0, 400), Err(Void::CpuMissing));
        assert_eq!(judged(390, 1, 1, 0, 200), Ok(()), "less was asked for");
    }

    #[test]
    fn time_that_the_hypervisor_took_voids_a_window_wherever_it_was() {
        assert_eq!(judged(300, 0, 0, 100, 400), Err(Void::CpuStolen));
        assert_eq!(judged(0, 0, 0, 20, 0), Err(Void::CpuStolen), "idle is fine");
        assert_eq!(judged(399, 0, 0, 10, 400), Err(Void::CpuStolen), "a step");
        assert_eq!(judged(399, 0, 0, 0, 400), Ok(()));
    }

    #[test]
    fn repeats_are_bounded_and_counted_by_their_reason() {
        let mut c = Collector::new(2, 3, 400 * MS);
        let late = [(0, 6, 0), (0, 0, 30), (0, 0, 0), (6, 0, 0), (0, 0, 20)]; // always void
        for (index, (ping_late, late, stolen)) in (0..).zip(late) {
            c.ping(ping(index, ping_late));
            assert!(!c.is_complete());
            c.pong(pong(index, 100, late, stolen));
        }
        assert!(c.is_complete());
        let repeated = c.repeated();
        assert_eq!(repeated.total(), 3);
        let each = [1, 0, 1, 1];
        assert_eq!(
            [
                repeated.snapshot_late,
                repeated.sender_late,
                repeated.cpu_stolen,
                repeated.cpu_missing
            ],
            each
        );
        assert_eq!(
            repeated.to_string(),
            "reading late: 1, CPU stolen by the hypervisor: 1, CPU with nobody of ours: 1"
        );
        let counted: Vec<_> = c.counted().iter().map(|w| w.disturbed).collect();
        assert_eq!(counted, [Some(Void::SenderLate), Some(Void::CpuStolen)]);
    }

    #[test]
    fn accounts_are_paired_in_any_order() {
        let mut c = Collector::new(2, 5, 400 * MS);
        c.pong(pong(1, 399, 0, 0));
        c.ping(ping(0, 0));
        c.ping(ping(1, 0));
        assert_eq!(c.counted().len(), 1);
        c.pong(pong(0, 399, 0, 0));
        assert!(c.is_complete());
        assert!(c.counted().iter().all(|w| w.disturbed.is_none()));
    }
}

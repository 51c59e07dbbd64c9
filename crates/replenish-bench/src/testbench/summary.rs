//! Counted windows summed up: the numbers of the table, of the JSON and of the plots.

use super::windows::{Repeated, Void, Window};
use crate::load::Nanos;
use crate::load::grid::Grid;
use crate::load::simulated::Prediction;
use crate::load::spec::{High, Spec};
use crate::load::theory::{self, Theory};
use crate::roles::protocol::WorkerWindow;
use replenish_cli::outcome::Failure;

/// One topic over all counted windows. The field names are the JSON contract of `demo --json`.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub(crate) struct Topic {
    /// Messages sent by ping.
    pub sent: u64,
    /// Answers received by ping.
    pub answered: u64,
    /// Answers published by pong.
    pub published: u64,
    /// Answers that theory expects: whole bursts that fit, per window.
    pub expected: u64,
    /// Answers that the simulator gives for these windows; absent for continuous load.
    pub simulated: Option<u64>,
    /// CPU time in percent of the windows.
    pub cpu_percent: f64,
    /// The part of it at the worker's own priority.
    pub high_priority_cpu_percent: f64,
    /// The part of it at the background priority.
    pub background_cpu_percent: f64,
    /// CPU time that theory expects, in percent of the windows.
    pub expected_cpu_percent: f64,
    /// CPU time at the high priority against the budget, in percent of the budget; absent
    /// without a budget or when less was asked for than the budget.
    pub budget_error_percent: Option<f64>,
    /// Times the budget ran out.
    pub exhaustions: u64,
}

/// A run in numbers.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub(crate) struct Summary {
    /// The topic with the budget.
    pub high: Topic,
    /// The other one.
    pub low: Topic,
    /// Windows that count.
    pub windows: u64,
    /// Windows that were offered again because the machine did not give what was measured.
    pub windows_repeated: u64,
    /// The same by reason.
    pub windows_repeated_because: Repeated,
    /// Windows that count although the clocks speak against them: no repeats were left.
    pub windows_disturbed: u64,
    /// Length of a window in milliseconds.
    pub window_ms: f64,
    /// CPU time of dispatcher and enforcer, in percent of the windows.
    pub support_cpu_percent: f64,
    /// The enforcers' part of it.
    pub enforcer_cpu_percent: f64,
    /// CPU time that the hypervisor took, in percent of the windows; steps of 10 ms in each window.
    pub stolen_percent: f64,
    /// Idle time of the CPU, in percent of the windows; steps of 10 ms in each window.
    pub idle_percent: f64,
    /// The largest difference of one topic's measured answers in one window.
    pub simulated_worst_difference: Option<u64>,
    /// CPU time that no worker, dispatcher or enforcer used, in percent of the windows.
    pub unused_cpu_percent: f64,
    /// Each window that counts, in order.
    pub per_window: Vec<PerWindow>,
}

/// One window in numbers.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub(crate) struct PerWindow {
    /// Its number, repeated ones included.
    pub index: u64,
    /// CPU time of the high worker at its own priority, in percent of the window.
    pub high_priority_cpu_percent: f64,
    /// CPU time of the high worker in the background.
    pub background_cpu_percent: f64,
    /// CPU time of the low worker.
    pub low_cpu_percent: f64,
    /// Answers to the high topic that ping received.
    pub high_answered: u64,
    /// Answers to the low topic that ping received.
    pub low_answered: u64,
    /// Times the budget ran out.
    pub exhaustions: u64,
    /// CPU time that the hypervisor took, in steps of 10 ms.
    pub stolen_ms: f64,
    /// The reason why it should not count, if it does only because no repeats were left.
    pub disturbed: Option<Void>,
    /// Answers that the simulator gives; absent for continuous load.
    pub simulated: Option<Prediction>,
}

impl Summary {
    /// CPU time of interrupts and other programs, in percent of the windows.
    ///
    /// The workers and the executor's own threads did not use that time, the hypervisor did not
    /// take it, and the CPU was not idle.
    pub(crate) fn others_percent(&self) -> f64 {
        round((self.unused_cpu_percent - self.stolen_percent - self.idle_percent).max(0.0))
    }

    /// The CPU time that was there for the high worker, in percent of the windows: the theory for a
    /// machine without what dispatcher, enforcer, hypervisor and others took. The budget comes
    /// first; what is missing is missing in the background. Idle time is not subtracted: it was
    /// there.
    pub(crate) fn to_be_had_percent(&self, budget_percent: f64) -> f64 {
        let theory = self.high.expected_cpu_percent;
        let there = 100.0 - self.support_cpu_percent - self.stolen_percent - self.others_percent();
        let part = (there - budget_percent).max(0.0) / (100.0 - budget_percent).max(1.0);
        round(budget_percent.min(theory) + (theory - budget_percent).max(0.0) * part)
    }

    /// Adds what the simulator says about each window, which it is asked for by its number.
    pub(crate) fn simulated(
        mut self,
        window: impl Fn(u64) -> Result<Prediction, Failure>,
    ) -> Result<Self, Failure> {
        let (mut high, mut low, mut worst) = (0, 0, 0);
        for measured in &mut self.per_window {
            let simulated = window(measured.index)?;
            let off = measured.high_answered.abs_diff(simulated.high);
            worst = worst.max(off.max(measured.low_answered.abs_diff(simulated.low)));
            high += simulated.high;
            low += simulated.low;
            measured.simulated = Some(simulated);
        }
        self.high.simulated = Some(high);
        self.low.simulated = Some(low);
        self.simulated_worst_difference = Some(worst);
        Ok(self)
    }
}

impl PerWindow {
    fn of(w: &Window, grid: &Grid) -> Self {
        let percent = |t: Nanos| round(as_f64(t) * 100.0 / as_f64(grid.window.max(1)));
        Self {
            index: w.pong.index,
            high_priority_cpu_percent: percent(w.pong.high.cpu_high),
            background_cpu_percent: percent(w.pong.high.cpu_low),
            low_cpu_percent: percent(w.pong.low.cpu_high + w.pong.low.cpu_low),
            high_answered: w.ping.received_high,
            low_answered: w.ping.received_low,
            exhaustions: w.pong.high.exhaustions,
            stolen_ms: as_f64(w.pong.stolen) / 1e6,
            disturbed: w.disturbed,
            simulated: None,
        }
    }
}

/// Sums up the windows of a run with load `spec` on `grid`.
pub(crate) fn summarise(
    spec: &Spec,
    grid: &Grid,
    windows: &[Window],
    repeated: Repeated,
) -> Summary {
    let time = as_f64(grid.window) * windows.len() as f64;
    let percent = |t: Nanos| {
        if time > 0.0 {
            round(as_f64(t) * 100.0 / time)
        } else {
            0.0
        }
    };

    let mut high = Total::default();
    let mut low = Total::default();
    let mut support: Nanos = 0;
    for w in windows {
        let t = theory::per_window(spec, grid, w.ping.sent_high);
        let l = theory::per_window(spec, grid, w.ping.sent_low);
        high.add(
            &w.pong.high,
            w.ping.sent_high,
            w.ping.received_high,
            t.high_answers,
        );
        low.add(
            &w.pong.low,
            w.ping.sent_low,
            w.ping.received_low,
            l.low_answers,
        );
        high.expect(&t, t.high_priority + t.background);
        low.expect(&l, l.low);
        support += w.pong.support_cpu;
    }
    let budget = match spec.high {
        High::Sporadic { .. } => Some(high.theory_high),
        High::Fifo => None,
    };
    let used = high.cpu() + low.cpu() + support;
    Summary {
        high: high.topic(&percent, budget),
        low: low.topic(&percent, None),
        windows: windows.len() as u64,
        windows_repeated: repeated.total(),
        windows_repeated_because: repeated,
        windows_disturbed: windows.iter().filter(|w| w.disturbed.is_some()).count() as u64,
        window_ms: as_f64(grid.window) / 1e6,
        simulated_worst_difference: None,
        per_window: windows.iter().map(|w| PerWindow::of(w, grid)).collect(),
        support_cpu_percent: percent(support),
        enforcer_cpu_percent: percent(windows.iter().map(|w| w.pong.enforcer_cpu).sum()),
        stolen_percent: percent(windows.iter().map(|w| w.pong.stolen).sum()),
        idle_percent: percent(windows.iter().map(|w| w.pong.idle).sum()),
        unused_cpu_percent: round((100.0 - as_f64(used) * 100.0 / time.max(1.0)).max(0.0)),
    }
}

/// Sums of one topic.
#[derive(Debug, Default)]
struct Total {
    sent: u64,
    received: u64,
    published: u64,
    expected: u64,
    cpu_high: Nanos,
    cpu_low: Nanos,
    exhaustions: u64,
    theory_high: Nanos,
    theory_cpu: Nanos,
}

impl Total {
    fn add(&mut self, worker: &WorkerWindow, sent: u64, received: u64, expected: u64) {
        self.sent += sent;
        self.received += received;
        self.published += worker.answered;
        self.expected += expected;
        self.cpu_high += worker.cpu_high;
        self.cpu_low += worker.cpu_low;
        self.exhaustions += worker.exhaustions;
    }

    fn expect(&mut self, theory: &Theory, cpu: Nanos) {
        self.theory_high += theory.high_priority;
        self.theory_cpu += cpu;
    }

    fn cpu(&self) -> Nanos {
        self.cpu_high + self.cpu_low
    }

    fn topic(&self, percent: &dyn Fn(Nanos) -> f64, budget: Option<Nanos>) -> Topic {
        Topic {
            sent: self.sent,
            answered: self.received,
            published: self.published,
            expected: self.expected,
            simulated: None,
            cpu_percent: percent(self.cpu()),
            high_priority_cpu_percent: percent(self.cpu_high),
            background_cpu_percent: percent(self.cpu_low),
            expected_cpu_percent: percent(self.theory_cpu),
            budget_error_percent: budget
                .filter(|b| *b > 0)
                .map(|b| round((as_f64(self.cpu_high) - as_f64(b)) * 100.0 / as_f64(b))),
            exhaustions: self.exhaustions,
        }
    }
}

/// Rounds to four decimals: these show a thousandth of a percent of a budget.
pub(crate) fn round(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

/// Nanoseconds as a float; exact up to 104 days.
pub(crate) fn as_f64(t: Nanos) -> f64 {
    t as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::MS;
    use crate::roles::protocol::{PingWindow, PongWindow};

    fn window(high_ms: u64, low_ms: u64) -> Window {
        let cpu = |ms: u64, answered| WorkerWindow {
            cpu_high: ms * MS,
            answered,
            ..WorkerWindow::default()
        };
        Window {
            pong: PongWindow {
                high: cpu(high_ms, 11),
                low: cpu(low_ms, 27),
                support_cpu: 2 * MS,
                ..PongWindow::default()
            },
            ping: PingWindow {
                sent_high: 40,
                sent_low: 40,
                received_high: 11,
                received_low: 27,
                ..PingWindow::default()
            },
            disturbed: None,
        }
    }

    #[test]
    fn sums_and_errors() {
        let spec = Spec::paper(30 * MS, 100 * MS);
        let grid = Grid::windowed(0, spec.period, spec.interval);
        let mut stolen = window(123, 275);
        stolen.disturbed = Some(Void::CpuStolen);
        stolen.pong.stolen = 30 * MS;
        let repeated = Repeated {
            cpu_stolen: 1,
            ..Repeated::default()
        };
        let s = summarise(&spec, &grid, &[window(120, 276), stolen], repeated);
        assert_eq!(
            (s.high.sent, s.high.answered, s.high.expected),
            (80, 22, 24)
        );
        assert_eq!((s.low.answered, s.low.expected), (54, 56));
        assert_eq!(s.high.cpu_percent, 30.375);
        assert_eq!(s.high.budget_error_percent, Some(1.25));
        assert_eq!(s.low.budget_error_percent, None);
        assert_eq!(s.support_cpu_percent, 0.5);
        assert_eq!(s.unused_cpu_percent, 0.25);
        assert_eq!((s.windows, s.windows_repeated), (2, 1));
        assert_eq!(s.windows_repeated_because, repeated);
        assert_eq!(s.windows_disturbed, 1);
        assert_eq!(s.per_window[1].stolen_ms, 30.0);
    }

    #[test]
    fn what_was_not_there_is_missing_in_the_background_and_idle_time_was_there() {
        let spec = Spec::work_conserving(50);
        let grid = Grid::windowed(0, spec.period, spec.interval);
        let mut w = window(240, 132);
        w.pong.support_cpu = 8 * MS;
        w.pong.stolen = 10 * MS;
        w.pong.idle = 10 * MS;
        let s = summarise(&spec, &grid, &[w], Repeated::default());
        assert_eq!(s.high.expected_cpu_percent, 65.0);
        assert_eq!(
            (s.support_cpu_percent, s.stolen_percent, s.idle_percent),
            (2.0, 2.5, 2.5)
        );
        assert_eq!(s.others_percent(), 0.0);
        // Half of 95.5 - 30.
        assert_eq!(s.to_be_had_percent(30.0), 62.75);
    }

    #[test]
    fn the_simulators_counts_are_compared_window_by_window() {
        let spec = Spec::paper(30 * MS, 100 * MS);
        let grid = Grid::windowed(0, spec.period, spec.interval);
        let prediction = |_| Ok(Prediction { high: 12, low: 28 });
        let mut far = window(120, 276);
        far.ping.received_low = 25;
        let s = summarise(&spec, &grid, &[window(120, 276), far], Repeated::default());
        let s = s.simulated(prediction).unwrap();
        assert_eq!((s.high.simulated, s.low.simulated), (Some(24), Some(56)));
        assert_eq!(s.simulated_worst_difference, Some(3));
    }

    #[test]
    fn no_window_is_no_number_and_no_panic() {
        let spec = Spec::fifo(100 * MS);
        let grid = Grid::windowed(0, spec.period, spec.interval);
        let s = summarise(&spec, &grid, &[], Repeated::default());
        assert_eq!(s.high.cpu_percent, 0.0);
        assert_eq!(s.high.budget_error_percent, None);
    }
}

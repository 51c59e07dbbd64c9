//! Runs that were measured elsewhere, on a board: read from a file, so that they are reported like
//! those of this machine. `cargo xtask board experiment` writes it.

use super::orchestrator::Run;
use super::summary::summarise;
use super::windows::{Repeated, Window};
use crate::load::grid::Grid;
use crate::load::simulated::{self, Arrivals, Costs};
use crate::load::spec::{INTERVAL, Spec};
use crate::load::{MS, Nanos};
use crate::roles::protocol::{Mode, PingWindow, PongEnd, PongWindow, WorkerWindow};
use replenish_cli::outcome::Failure;
use std::path::Path;

/// The points of an experiment.
#[derive(Debug, serde::Deserialize)]
pub(crate) struct Measured {
    /// Each of them.
    pub points: Vec<Point>,
}

/// One point: one window, without a pause.
#[derive(Debug, serde::Deserialize)]
pub(crate) struct Point {
    /// The budget of the high worker; absent for two FIFO workers.
    pub budget_ms: Option<u64>,
    /// Sleep of the low callback, in percent.
    pub sleep_percent: u8,
    /// The length of the window.
    length_ms: u64,
    /// Measurements of the board.
    pong: PongWindow,
    /// Counts of ping.
    ping: PingWindow,
}

impl Measured {
    /// Reads the file at `path`.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let failed = |why: &dyn std::fmt::Display| {
            Failure::refused(format!("cannot read {}: {why}", path.display()))
        };
        let text = std::fs::read_to_string(path).map_err(|e| failed(&e))?;
        serde_json::from_str(&text).map_err(|e| failed(&e))
    }
}

impl Point {
    /// As a run of load `spec`, with what the simulator says of it.
    ///
    /// # Errors
    /// A value of the load that the simulator does not take, by name.
    pub(crate) fn run(&self, spec: &Spec) -> Result<Run, Failure> {
        let grid = Grid {
            epoch: 0,
            window: self.length_ms.saturating_mul(MS),
            pause: 0,
            interval: INTERVAL,
        };
        let windows = vec![Window {
            pong: self.pong.clone(),
            ping: self.ping,
            disturbed: None,
        }];
        let (costs, none) = (self.costs(spec), Arrivals::default());
        let told = simulated::Measured {
            costs,
            arrivals: [&none, &none],
        };
        let summary = summarise(spec, &grid, &windows, Repeated::default());
        Ok(Run {
            summary: summary.simulated(|w| simulated::window(spec, &grid, w, &told))?,
            grid,
            windows,
            mode: Mode::Enforced,
            threads: Vec::new(),
            end: PongEnd {
                costs,
                ..PongEnd::default()
            },
            notes: Vec::new(),
        })
    }

    /// The costs that the simulator counts with.
    ///
    /// On the board an answer takes its burst by the worker's CPU clock, handling included. An
    /// answer without a burst takes the measured CPU time.
    fn costs(&self, spec: &Spec) -> Costs {
        let messages = self.ping.sent_high.saturating_add(self.ping.sent_low);
        let answer = |burn: Nanos, cpu: Nanos, answered: u64| {
            let all = match burn {
                0 => cpu.checked_div(answered).unwrap_or(0),
                burn => burn,
            };
            all.saturating_sub(spec.net(burn))
        };
        let (high, low) = (&self.pong.high, &self.pong.low);
        let cpu = |w: &WorkerWindow| w.cpu_high.saturating_add(w.cpu_low);
        Costs {
            dispatch: self.pong.support_cpu.checked_div(messages).unwrap_or(0),
            high: answer(spec.burst, cpu(high), high.answered),
            low: answer(spec.low_burn(), cpu(low), low.answered),
            low_after: 0,
            wake_up: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_boards_run_is_summed_up_like_one_of_this_machine() {
        let text = r#"{"points": [{"budget_ms": 30, "sleep_percent": 0, "length_ms": 10000,
            "pong": {"index": 0, "support_cpu": 100000000, "late": 0, "high_slices": [], "low_slices": [],
                "high": {"cpu_high": 3000000000, "cpu_low": 0, "answered": 299, "exhaustions": 100},
                "low": {"cpu_high": 6900000000, "cpu_low": 0, "answered": 689, "exhaustions": 0}},
            "ping": {"index": 0, "sent_high": 1000, "sent_low": 1000, "received_high": 299,
                "received_low": 689, "late": 0}}]}"#;
        let measured: Measured = serde_json::from_str(text).unwrap();
        let point = measured.points.first().unwrap();
        let run = point.run(&Spec::paper(30 * MS, 100 * MS)).unwrap();
        assert_eq!(run.summary.high.expected, 300);
        assert_eq!(run.summary.low.expected, 700);
        assert_eq!(run.summary.high.cpu_percent, 30.0);
        assert_eq!(run.summary.support_cpu_percent, 1.0);
        assert_eq!(run.summary.high.budget_error_percent, Some(0.0));
        // 2000 messages took 100 ms of dispatcher and enforcer, an answer its 10 ms and nothing
        // besides.
        let costs = run.end.costs;
        assert_eq!(
            (costs.dispatch, costs.high, costs.low),
            (50_000, 100_000, 100_000)
        );
        let simulated = run.summary.per_window.first().and_then(|w| w.simulated);
        let simulated = simulated.unwrap();
        assert!(simulated.high.abs_diff(300) <= 1, "{simulated:?}");
        assert!(simulated.low.abs_diff(690) <= 1, "{simulated:?}");
    }
}

//! Runs that were measured elsewhere, on a board: read from a file, so that they are reported like
//! those of this machine. `cargo xtask board experiment` writes it.

use super::summary::summarise;
use super::triple::Run;
use super::windows::{Repeated, Window};
use crate::load::MS;
use crate::load::grid::Grid;
use crate::load::spec::{INTERVAL, Spec};
use crate::outcome::Failure;
use crate::parts::protocol::{Mode, PingWindow, PongEnd, PongWindow};
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
    /// The budget of the high worker.
    pub budget_ms: u64,
    /// What the low callback slept, in percent.
    pub sleep_percent: u8,
    /// The length of the window.
    length_ms: u64,
    /// What the board measured.
    pong: PongWindow,
    /// What ping counted.
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
    /// As a run of load `spec`.
    pub(crate) fn run(&self, spec: &Spec) -> Run {
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
        Run {
            summary: summarise(spec, &grid, &windows, Repeated::default()),
            grid,
            windows,
            mode: Mode::Enforced,
            threads: Vec::new(),
            end: PongEnd::default(),
            notes: Vec::new(),
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
        let run = point.run(&Spec::paper(30 * MS, 100 * MS));
        assert_eq!(run.summary.high.expected, 300);
        assert_eq!(run.summary.low.expected, 700);
        assert_eq!(run.summary.high.cpu_percent, 30.0);
        assert_eq!(run.summary.support_cpu_percent, 1.0);
        assert_eq!(run.summary.high.budget_error_percent, Some(0.0));
    }
}

//! Figures of the windows: table and JSON.

use super::Setting;
use super::threads::Used;
use crate::machine::stats::{Sorted, us};
use crate::report::table::Table;

/// One window of one receiver.
#[derive(Debug)]
pub(super) struct Window {
    /// Messages sent.
    pub sent: u64,
    /// How long each took that came.
    pub times: Vec<i64>,
    /// What the receiving threads used.
    pub used: Used,
}

impl Window {
    fn each(&self, total: u64) -> f64 {
        total as f64 / (self.times.len().max(1) as f64)
    }
}

/// One receiver over all windows. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Figures {
    p50_us: f64,
    p99_us: f64,
    /// The median over windows.
    cpu_us_per_message: f64,
    voluntary_switches_per_message: f64,
    sent: u64,
    received: usize,
}

impl Figures {
    fn of(windows: &[&Window]) -> Self {
        let times = windows.iter().flat_map(|w| w.times.iter().copied());
        let times = Sorted::new(times.collect());
        let cpu = windows.iter().map(|w| w.each(w.used.cpu)).collect();
        let switches = windows.iter().map(|w| w.each(w.used.voluntary_switches));
        Self {
            p50_us: us(times.median()),
            p99_us: us(times.percentile(99)),
            cpu_us_per_message: round(median(cpu) / 1e3),
            voluntary_switches_per_message: round(median(switches.collect())),
            sent: windows.iter().map(|w| w.sent).sum(),
            received: times.len(),
        }
    }
}

/// One number of handles. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(super) struct Point {
    handles: u16,
    rate_hz: u64,
    #[serde(flatten)]
    ours: Figures,
    baseline: Figures,
    /// CPU time per message against the raw loop's: the median over pairs of windows.
    cpu_ratio: f64,
    windows_repeated: u64,
    granted: String,
}

impl Point {
    /// From pairs of windows: ours, the raw loop's.
    pub(super) fn new(
        handles: u16,
        rate_hz: u64,
        pairs: Vec<(Window, Window)>,
        windows_repeated: u64,
        granted: String,
    ) -> Self {
        let ratio = |(ours, raw): &(Window, Window)| {
            ours.each(ours.used.cpu) / raw.each(raw.used.cpu).max(1.0)
        };
        let (ours, raw): (Vec<_>, Vec<_>) = pairs.iter().map(|(o, r)| (o, r)).unzip();
        Self {
            handles,
            rate_hz,
            ours: Figures::of(&ours),
            baseline: Figures::of(&raw),
            cpu_ratio: round(median(pairs.iter().map(ratio).collect())),
            windows_repeated,
            granted,
        }
    }
}

/// `bench dispatch --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(super) struct Json {
    points: Vec<Point>,
    /// The highest CPU time per message of all points against that of the first, each in units of
    /// its own baseline.
    worst_growth: f64,
    cpu: usize,
    sender_cpu: usize,
}

impl Json {
    pub(super) fn new(points: Vec<Point>, setting: Setting) -> Self {
        let first = points.first().map_or(1.0, |p| p.cpu_ratio).max(1e-3);
        let grown = points.iter().map(|p| p.cpu_ratio / first);
        Self {
            worst_growth: round(grown.fold(0.0, f64::max)),
            points,
            cpu: setting.cpu,
            sender_cpu: setting.support,
        }
    }

    pub(super) fn print(&self) {
        let mut table = Table::new(&[
            "handles",
            "rate Hz",
            "p50 us",
            "p99 us",
            "CPU us",
            "raw CPU us",
            "ratio",
            "switches",
            "raw",
            "received",
        ]);
        for p in &self.points {
            table.row([
                p.handles.to_string(),
                p.rate_hz.to_string(),
                format!("{:.1}", p.ours.p50_us),
                format!("{:.1}", p.ours.p99_us),
                format!("{:.2}", p.ours.cpu_us_per_message),
                format!("{:.2}", p.baseline.cpu_us_per_message),
                format!("{:.2}", p.cpu_ratio),
                format!("{:.2}", p.ours.voluntary_switches_per_message),
                format!("{:.2}", p.baseline.voluntary_switches_per_message),
                format!("{}/{}", p.ours.received, p.ours.sent),
            ]);
        }
        println!(
            "{}  CPU time and switches per message, of dispatcher and worker and of the raw loop, on \
             CPU {}; times pass the agent on CPU {}\n  most handles against fewest: {:.2}",
            table.to_text(),
            self.cpu,
            self.sender_cpu,
            self.worst_growth
        );
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn round(x: f64) -> f64 {
    (x * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_those_of_pairs_and_costs_are_per_message() {
        let window = |cpu, n| Window {
            sent: 4,
            times: vec![1000; n],
            used: Used {
                cpu,
                voluntary_switches: 8,
            },
        };
        let pairs = vec![
            (window(8_000, 4), window(4_000, 4)),
            (window(12_000, 4), window(4_000, 4)),
            (window(9_000, 3), window(4_000, 4)),
        ];
        let p = Point::new(10, 1000, pairs, 0, String::new());
        assert_eq!(p.cpu_ratio, 3.0);
        assert_eq!(p.ours.cpu_us_per_message, 3.0);
        assert_eq!((p.ours.sent, p.ours.received), (12, 11));
        assert_eq!(p.baseline.voluntary_switches_per_message, 2.0);
    }
}

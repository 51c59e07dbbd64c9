//! Figures of the windows: table and JSON.

use super::receiver::Setting;
use super::window::{Window, Windows};
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::report::table::Table;

/// Figures of one receiver over all windows. The names are a contract.
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

/// Figures for one number of handles. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(super) struct Point {
    handles: u16,
    rate_hz: u64,
    #[serde(flatten)]
    ours: Figures,
    /// CPU time per message against the raw loop's: the median over windows that follow each other.
    cpu_ratio: f64,
    /// A dispatcher and a worker.
    threads: Figures,
    threads_cpu_ratio: f64,
    /// The raw loop that can be woken otherwise, too.
    waiting: Figures,
    waiting_cpu_ratio: f64,
    baseline: Figures,
    windows_repeated: u64,
}

impl Point {
    /// From windows of ours in one thread and with a worker's, of the raw loop that waits, and of
    /// the raw loop.
    pub(super) fn new(
        handles: u16,
        rate_hz: u64,
        windows: &[Windows],
        windows_repeated: u64,
    ) -> Self {
        let figures = |of: usize| Figures::of(&windows.iter().map(|w| &w[of]).collect::<Vec<_>>());
        let cpu = |w: &Window| w.each(w.used.cpu);
        let ratio = |of: usize| {
            let each = windows.iter().map(|w| cpu(&w[of]) / cpu(&w[3]).max(1.0));
            round(median(each.collect()))
        };
        Self {
            handles,
            rate_hz,
            ours: figures(0),
            cpu_ratio: ratio(0),
            threads: figures(1),
            threads_cpu_ratio: ratio(1),
            waiting: figures(2),
            waiting_cpu_ratio: ratio(2),
            baseline: figures(3),
            windows_repeated,
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
    threads_worst_growth: f64,
    cpu: usize,
    sender_cpu: usize,
    /// The measured CPU was kept from sleeping.
    awake: bool,
}

impl Json {
    pub(super) fn new(points: Vec<Point>, setting: Setting) -> Self {
        let worst = |ratio: fn(&Point) -> f64| {
            let first = points.first().map_or(1.0, ratio).max(1e-3);
            round(points.iter().map(|p| ratio(p) / first).fold(0.0, f64::max))
        };
        Self {
            worst_growth: worst(|p| p.cpu_ratio),
            threads_worst_growth: worst(|p| p.threads_cpu_ratio),
            points,
            cpu: setting.cpu,
            sender_cpu: setting.support,
            awake: setting.awake,
        }
    }

    pub(super) fn print(&self) {
        let mut table = Table::new(&[
            "handles", "executor", "p50 us", "p99 us", "CPU us", "x raw", "switches", "received",
        ]);
        for p in &self.points {
            let rows = [
                ("one thread", &p.ours, p.cpu_ratio),
                ("threads", &p.threads, p.threads_cpu_ratio),
                ("raw, epoll", &p.waiting, p.waiting_cpu_ratio),
                ("raw loop", &p.baseline, 1.0),
            ];
            for (name, f, ratio) in rows {
                table.row([
                    p.handles.to_string(),
                    name.to_string(),
                    format!("{:.1}", f.p50_us),
                    format!("{:.1}", f.p99_us),
                    format!("{:.2}", f.cpu_us_per_message),
                    format!("{ratio:.2}"),
                    format!("{:.2}", f.voluntary_switches_per_message),
                    format!("{}/{}", f.received, f.sent),
                ]);
            }
        }
        let state = if self.awake {
            "kept awake"
        } else {
            "asleep between messages"
        };
        println!(
            "{}  per message; CPU time and switches are those of the receiving threads, on CPU {} \
             ({state}); what ours receives passes the agent on CPU {}\n  growth of CPU time from \
             the first to the worst point: one thread {:.2}, threads {:.2}",
            table.to_text(),
            self.cpu,
            self.sender_cpu,
            self.worst_growth,
            self.threads_worst_growth,
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
    use super::super::threads::Used;
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
        let each = |ours, n| {
            [
                window(ours, n),
                window(4_000, 4),
                window(6_000, 4),
                window(4_000, 4),
            ]
        };
        let windows = [each(8_000, 4), each(12_000, 4), each(9_000, 3)];
        let p = Point::new(10, 1000, &windows, 0);
        assert_eq!((p.cpu_ratio, p.threads_cpu_ratio), (3.0, 1.0));
        assert_eq!(p.waiting_cpu_ratio, 1.5);
        assert_eq!(p.ours.cpu_us_per_message, 3.0);
        assert_eq!((p.ours.sent, p.ours.received), (12, 11));
        assert_eq!(p.baseline.voluntary_switches_per_message, 2.0);
    }
}

//! The figures of `bench ros2`: a table and the JSON.

use super::encoding::Encoding;
use super::fragments::Fragments;
use super::windows::{Measured, Record};
use crate::bench::in_process::InProcessPoint;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::report::table::Table;

/// One of `points`. The names are a contract: docs/schemas/bench-ros2.json.
#[derive(Debug, serde::Serialize)]
pub(super) struct Point {
    bytes: usize,
    path: &'static str,
    p50_us: f64,
    p99_us: f64,
    cpu_us_per_message: f64,
    samples: usize,
    lost: u64,
    threads: usize,
}

/// A control loop beside a flood on another topic.
#[derive(Debug, serde::Serialize)]
pub(super) struct Flood {
    pub(super) quiet_p99_us: f64,
    pub(super) flood_p99_us: f64,
    pub(super) raw_quiet_p99_us: f64,
    pub(super) raw_flood_p99_us: f64,
    pub(super) rcl_quiet_p99_us: Option<f64>,
    pub(super) rcl_flood_p99_us: Option<f64>,
    pub(super) dispatcher_quiet_cpu: f64,
    pub(super) dispatcher_flood_cpu: f64,
    pub(super) worker_flood_cpu: f64,
    pub(super) sent: u64,
    pub(super) dropped: u64,
}

/// `bench ros2 --json`.
#[derive(Debug, serde::Serialize)]
pub(super) struct Json {
    pub(super) points: Vec<Point>,
    pub(super) in_process: Vec<InProcessPoint>,
    pub(super) encodings: Vec<Encoding>,
    pub(super) fragments: Fragments,
    pub(super) flood: Option<Flood>,
    pub(super) left_out: Vec<String>,
    pub(super) cpu: usize,
    pub(super) granted: String,
}

/// The points, size by size.
pub(super) fn points(all: &[Measured]) -> Vec<Point> {
    let sizes = all.first().map_or(0, |first| first.records.len());
    let rows = (0..sizes).flat_map(|at| all.iter().map(move |of| (of, at)));
    let point = |(of, at): (&Measured, usize)| {
        let record: &Record = of.records.get(at)?;
        let times = Sorted::new(record.times.clone());
        // Two messages a round trip.
        let messages = 2.0 * times.len().max(1) as f64;
        Some(Point {
            bytes: record.bytes,
            path: of.path.name(),
            p50_us: us(times.median()),
            p99_us: us(times.percentile(99)),
            cpu_us_per_message: record.cpu as f64 / 1e3 / messages,
            samples: times.len(),
            lost: record.lost,
            threads: of.threads,
        })
    };
    rows.filter_map(point).collect()
}

impl Json {
    pub(super) fn print(&self) {
        let mut table = Table::new(&[
            "bytes", "path", "p50 us", "p99 us", "CPU us", "lost", "threads", "x p50", "x p99",
            "x CPU",
        ]);
        for point in &self.points {
            let base = self
                .points
                .iter()
                .find(|other| other.bytes == point.bytes && other.path == "cyclone");
            let figures = [point.p50_us, point.p99_us, point.cpu_us_per_message];
            let ratio = |of: fn(&Point) -> f64| {
                base.map_or("-".into(), |base| format!("{:.2}", of(point) / of(base)))
            };
            let ratios = [
                ratio(|point| point.p50_us),
                ratio(|point| point.p99_us),
                ratio(|point| point.cpu_us_per_message),
            ];
            let head = [point.bytes.to_string(), point.path.to_string()];
            let counts = [point.lost.to_string(), point.threads.to_string()];
            let figures = figures.map(|us| format!("{us:.1}"));
            table.row(head.into_iter().chain(figures).chain(counts).chain(ratios));
        }
        println!(
            "{}  reliable round trips, every process on CPU {}, {}; the paths take turns. CPU us: of \
             all threads at both ends, for each of the two messages; threads: of both; x: Cyclone DDS \
             is 1",
            table.to_text(),
            self.cpu,
            self.granted
        );
        for point in &self.in_process {
            println!(
                "in one process: {} bytes to {} workers in {:.1} us, {} bytes copied, {:.1} us of the \
                 publisher's CPU; waking as many bare threads by futexes takes {:.1} us, and {:.1} us \
                 of its CPU",
                point.bytes,
                point.readers,
                point.p50_us,
                point.copied_bytes,
                point.publisher_us,
                point.floor_us,
                point.floor_publisher_us
            );
        }
        for point in &self.encodings {
            println!(
                "a publication of {} bytes, encoded where its writer keeps it: {:.2} us of CPU; \
                 encoded into a buffer and copied there: {:.2} us",
                point.bytes, point.in_place_us, point.copied_us
            );
        }
        println!(
            "a fragment of {} bytes takes {:.2} us of CPU where sixteen go to the kernel together; \
             alone {:.2} us",
            self.fragments.bytes, self.fragments.together_us, self.fragments.alone_us
        );
        if let Some(flood) = &self.flood {
            let times = |flood: f64, quiet: f64| format!("{:.2} x", flood / quiet.max(1e-9));
            println!(
                "a control loop's p99 {:.1} us, beside a flood {:.1} us ({}); a raw UDP loop beside \
                 it {:.1} us, {:.1} us ({}); {} sent, of which {} were dropped",
                flood.quiet_p99_us,
                flood.flood_p99_us,
                times(flood.flood_p99_us, flood.quiet_p99_us),
                flood.raw_quiet_p99_us,
                flood.raw_flood_p99_us,
                times(flood.raw_flood_p99_us, flood.raw_quiet_p99_us),
                flood.sent,
                flood.dropped
            );
            if let (Some(quiet), Some(flooded)) = (flood.rcl_quiet_p99_us, flood.rcl_flood_p99_us) {
                println!(
                    "a control loop of rcl with Fast DDS, whose process takes the same flood on a \
                     second thread: p99 {quiet:.1} us, beside the flood {flooded:.1} us ({})",
                    times(flooded, quiet)
                );
            }
            println!(
                "who pays: the flood's worker {:.1} % of a CPU, the dispatcher {:.1} % ({:.1} % \
                 without the flood)",
                100.0 * flood.worker_flood_cpu,
                100.0 * flood.dispatcher_flood_cpu,
                100.0 * flood.dispatcher_quiet_cpu
            );
        }
    }
}

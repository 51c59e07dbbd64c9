//! The figures of `bench secure`: a table, the JSON, and whether all samples came back.

use super::measure::{Measured, Record, SIZES};
use super::path::PATHS;
use crate::load::Nanos;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::table::Table;

/// One of `points`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Point {
    path: &'static str,
    bytes: usize,
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
    agent_cpu_us_per_message: f64,
    client_cpu_us_per_message: f64,
    samples: usize,
    lost: u64,
    /// The path without encryption that the ratios are to.
    plain: &'static str,
    /// The median over windows of this path's median over that of the plain path's window.
    ratio_p50: f64,
    ratio_p99: f64,
    ratio_agent_cpu: f64,
}

/// `bench secure --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(super) struct Json {
    points: Vec<Point>,
    client_cpu: usize,
    agent_cpu: usize,
    granted: String,
}

impl Json {
    pub(super) fn new(measured: Measured, client_cpu: usize, agent_cpu: usize) -> Self {
        let sizes = SIZES.into_iter().zip(&measured.records);
        Self {
            points: sizes.flat_map(|(size, row)| points(size, row)).collect(),
            client_cpu,
            agent_cpu,
            granted: measured.granted,
        }
    }

    pub(super) fn print(&self) {
        let mut table = Table::new(&[
            "path",
            "bytes",
            "p50 us",
            "p99 us",
            "agent us",
            "client us",
            "x p50",
            "x p99",
            "x agent",
        ]);
        for point in &self.points {
            let figures = [
                point.p50_us,
                point.p99_us,
                point.agent_cpu_us_per_message,
                point.client_cpu_us_per_message,
            ];
            let ratios = [point.ratio_p50, point.ratio_p99, point.ratio_agent_cpu];
            let figures = figures.map(|us| format!("{us:.1}"));
            let ratios = ratios.map(|ratio| format!("{ratio:.2}"));
            let head = [point.path.to_string(), point.bytes.to_string()];
            table.row(head.into_iter().chain(figures).chain(ratios));
        }
        println!(
            "{}  reliable, client on CPU {}, agent on CPU {}, both {}; the paths take turns. agent us, \
             client us: CPU time for a round trip; x: the path without encryption is 1",
            table.to_text(),
            self.client_cpu,
            self.agent_cpu,
            self.granted
        );
    }

    /// An error if a sample did not come back.
    pub(super) fn check(&self) -> Outcome {
        match self.points.iter().find(|point| point.lost > 0) {
            Some(point) => Err(Failure::refused(format!(
                "{} samples of {} did not come back",
                point.lost, point.path
            ))),
            None => Ok(()),
        }
    }
}

fn points(bytes: usize, row: &[Record; PATHS.len()]) -> Vec<Point> {
    let [udp, dtls, tcp, tls] = row;
    let pairs = [(udp, udp), (dtls, udp), (tcp, tcp), (tls, tcp)];
    let [plain_udp, _, plain_tcp, _] = PATHS;
    let plain = [plain_udp, plain_udp, plain_tcp, plain_tcp];
    let named = PATHS.into_iter().zip(plain).zip(pairs);
    let point = |((path, plain), (record, base)): ((_, _), (&Record, &Record))| {
        let permille = |(ours, theirs): (&i64, &i64)| ours.saturating_mul(1000) / (*theirs).max(1);
        let ratios = record.medians.iter().zip(&base.medians).map(permille);
        let times = Sorted::new(record.times.clone());
        let base_times = Sorted::new(base.times.clone());
        let each = |cpu: Nanos| cpu as f64 / 1e3 / (times.len().max(1) as f64);
        let ratio = |ours: f64, theirs: f64| ours / theirs.max(1e-9);
        Point {
            path,
            bytes,
            p50_us: us(times.median()),
            p99_us: us(times.percentile(99)),
            max_us: us(times.max()),
            agent_cpu_us_per_message: each(record.agent_cpu),
            client_cpu_us_per_message: each(record.client_cpu),
            samples: times.len(),
            lost: record.lost,
            plain,
            ratio_p50: Sorted::new(ratios.collect()).median() as f64 / 1e3,
            ratio_p99: ratio(us(times.percentile(99)), us(base_times.percentile(99))),
            ratio_agent_cpu: ratio(record.agent_cpu as f64, base.agent_cpu as f64),
        }
    };
    named.map(point).collect()
}

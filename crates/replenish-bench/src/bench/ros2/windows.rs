//! All windows of all paths and sizes, which take turns.

use super::foreign::left_out;
use super::pair::Pair;
use super::path::Path;
use crate::load::{MS, Nanos};
use replenish_cli::outcome::Failure;
use replenish_os::{ThreadSpec, clock, spawn};

/// A window is so long, and so long is the pause after it: docs/measuring.md says why.
pub(super) const ON: Nanos = 400 * MS;
pub(super) const OFF: Nanos = 100 * MS;

/// Between two round trips.
fn period(bytes: usize) -> Nanos {
    if bytes < 512 * 1024 { MS } else { 10 * MS }
}

/// The windows of one path and size.
#[derive(Debug, Default, Clone)]
pub(super) struct Record {
    pub(super) bytes: usize,
    pub(super) times: Vec<i64>,
    pub(super) cpu: Nanos,
    pub(super) lost: u64,
}

/// The records of one path.
pub(super) struct Measured {
    pub(super) path: Path,
    pub(super) threads: usize,
    pub(super) records: Vec<Record>,
}

/// Paths, sizes and windows of a measurement.
pub(super) struct Plan {
    pub(super) paths: Vec<Path>,
    pub(super) bytes: Vec<usize>,
    pub(super) windows: u64,
    /// A domain for each path.
    pub(super) domains: Vec<u16>,
    pub(super) require: bool,
}

/// Measures, with processes that threads as `starter` says start. Also says which paths were left
/// out, and why.
pub(super) fn measure(
    plan: &Plan,
    starter: &ThreadSpec,
) -> Result<(Vec<Measured>, Vec<String>), Failure> {
    let (mut pairs, mut missing) = (Vec::new(), Vec::new());
    for (path, domain) in plan.paths.iter().copied().zip(plan.domains.iter().copied()) {
        let start = spawn(starter.clone(), move || Pair::start(path, domain));
        let started = start.map_err(Failure::refused)?.join();
        let path = &path;
        match started.map_err(|_| Failure::refused("a thread panicked"))?? {
            Ok(pair) => pairs.push((*path, pair)),
            Err(reason) => missing.push(left_out(path.name(), &reason, plan.require)?),
        }
    }
    let record = |bytes: &usize| Record {
        bytes: *bytes,
        ..Record::default()
    };
    let of = |(path, pair): &(Path, Pair)| Measured {
        path: *path,
        threads: pair.threads(),
        records: plan.bytes.iter().map(record).collect(),
    };
    let mut all: Vec<Measured> = pairs.iter().map(of).collect();
    // The first windows settle caches and queues, and do not count.
    for round in 0..=plan.windows {
        for (at, bytes) in plan.bytes.iter().enumerate() {
            for ((_, pair), measured) in pairs.iter_mut().zip(&mut all) {
                let on = if round == 0 { ON / 8 } else { ON };
                let period = period(*bytes);
                let window = pair.window(*bytes, on / period, period)?;
                clock::sleep_until(clock::monotonic() + OFF);
                if let Some(record) = measured.records.get_mut(at).filter(|_| round > 0) {
                    record.times.extend(window.times);
                    record.cpu += window.cpu;
                    record.lost += window.lost;
                }
            }
        }
    }
    Ok((all, missing))
}

//! All windows of all paths and sizes, which take turns.

use super::path::{LONGEST, PATHS, Path};
use crate::load::{MS, Nanos};
use replenish_cli::machine::stats::Sorted;
use replenish_cli::outcome::Failure;
use replenish_os::clock::{self, ThreadCpuClock};
use replenish_os::{current_tid, granted};

/// Bytes of a sample.
pub(super) const SIZES: [usize; 2] = [64, LONGEST];

/// Round trips in one window of one path.
const WINDOW: usize = 200;

/// Round trips of a window that do not count: caches and queues settle.
const WARM_UP: usize = 20;

/// The result of one path for one size.
#[derive(Debug, Default)]
pub(super) struct Record {
    pub(super) times: Vec<i64>,
    pub(super) medians: Vec<i64>,
    pub(super) agent_cpu: Nanos,
    pub(super) client_cpu: Nanos,
    pub(super) lost: u64,
}

/// All records, by size and path.
#[derive(Debug, Default)]
pub(super) struct Measured {
    pub(super) records: [[Record; PATHS.len()]; SIZES.len()],
    /// The policy of the client's thread.
    pub(super) granted: String,
}

/// Measures `samples` round trips of each path and size.
pub(super) fn measure(
    mut paths: [Path; PATHS.len()],
    agent: ThreadCpuClock,
    samples: usize,
) -> Result<Measured, Failure> {
    let mut all = Measured {
        granted: granted(current_tid())
            .map_err(Failure::refused)?
            .to_string(),
        ..Measured::default()
    };
    let windows = samples.div_ceil(WINDOW - WARM_UP);
    let mut count = 0_u64;
    for _ in 0..windows {
        for (size, records) in SIZES.into_iter().zip(&mut all.records) {
            let mut sample = vec![0_u8; size];
            for (path, record) in paths.iter_mut().zip(records) {
                window(path, agent, (&mut sample, &mut count), record)?;
                // Keeps far from the throttle of real-time threads.
                clock::sleep_until(clock::monotonic() + 2 * MS);
            }
        }
    }
    Ok(all)
}

fn window(
    path: &mut Path,
    agent: ThreadCpuClock,
    (sample, count): (&mut [u8], &mut u64),
    record: &mut Record,
) -> Result<(), Failure> {
    let cpu = || (clock::thread_cpu(), agent.read().unwrap_or(0));
    let mut times = Vec::with_capacity(WINDOW);
    let mut begun = cpu();
    for number in 0..WINDOW {
        if number == WARM_UP {
            begun = cpu();
        }
        *count += 1;
        if let Some(stamp) = sample.first_chunk_mut::<8>() {
            *stamp = count.to_le_bytes();
        }
        match path.round_trip(sample)? {
            Some(time) if number >= WARM_UP => times.push(i64::try_from(time).unwrap_or(i64::MAX)),
            Some(_) => {}
            None => record.lost += 1,
        }
    }
    path.settle()?;
    let ended = cpu();
    record.client_cpu += ended.0.saturating_sub(begun.0);
    record.agent_cpu += ended.1.saturating_sub(begun.1);
    record.medians.push(Sorted::new(times.clone()).median());
    record.times.extend(times);
    Ok(())
}

//! Chains from program to program: the name of a chain goes with the samples that its last stage
//! publishes, and the first stage of a chain of that name in another program goes on with it.
//!
//! Names are numbers for that, in a table of the process that only grows: a message reads it
//! without a lock.

use super::current::current;
use crate::Nanos;
use crate::handoff::{Origins, published_at};
use crate::platform::wall_clock;
use core::sync::atomic::{AtomicU64, Ordering};
use replenish_os::clock;

/// Names of chains in the life of a process; later ones stay in it.
const NAMES: usize = 256;
/// In a link's number: the last stage of a chain with this name has published the sample.
const SENT: u32 = 1 << 31;
/// In a link's number: the same, in another process.
const CAME: u32 = SENT | 1 << 30;

static TABLE: [AtomicU64; NAMES] = [const { AtomicU64::new(0) }; NAMES];

/// A chain's name as a number; 0 where the table is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChainName(u32);

impl ChainName {
    pub(crate) fn of(name: &str) -> Self {
        let hash = hash(name);
        let is_ours = |place: &AtomicU64| {
            let taken = place.compare_exchange(0, hash, Ordering::Relaxed, Ordering::Relaxed);
            taken.is_ok() || taken == Err(hash)
        };
        let at = TABLE.iter().position(is_ours);
        Self(at.and_then(|at| u32::try_from(at + 1).ok()).unwrap_or(0))
    }

    /// The link that samples of the last stage come from.
    pub(super) const fn sent(self) -> u32 {
        if self.0 == 0 { 0 } else { SENT | self.0 }
    }

    /// The link that such samples come from which another process has published.
    pub(super) const fn came(self) -> u32 {
        if self.0 == 0 { 0 } else { CAME | self.0 }
    }
}

/// FNV-1a; never 0.
fn hash(name: &str) -> u64 {
    let step = |sum: u64, byte: u8| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    name.bytes().fold(0xcbf2_9ce4_8422_2325, step).max(1)
}

/// Wall clock and monotonic clock of one moment.
fn clocks() -> Option<(Nanos, Nanos)> {
    let wall = u64::try_from(wall_clock()?.as_nanos()).ok()?;
    Some((wall, clock::monotonic()))
}

/// Of a sample that is published now: the chains whose last stage publishes it, with the time of
/// the wall clock at which the instance began.
pub(crate) fn sent<const N: usize>() -> [(u64, Nanos); N] {
    let mut all = [(0, 0); N];
    let origins = current();
    if origins.is_empty() {
        return all;
    }
    let named = origins.links().filter(|(link, _)| link & CAME == SENT);
    let Some((wall, now)) = clocks() else {
        return all;
    };
    for (place, (link, instant)) in all.iter_mut().zip(named) {
        let at = usize::try_from((link & !CAME).wrapping_sub(1)).ok();
        let hash = at.and_then(|at| TABLE.get(at));
        let hash = hash.map_or(0, |hash| hash.load(Ordering::Relaxed));
        *place = (hash, wall.saturating_sub(now.saturating_sub(instant)));
    }
    all
}

/// Of a sample of another process that arrived at `arrival`. An instant that cannot be by this
/// host's clock does not count.
pub(crate) fn came(chains: &[(u64, Nanos)], arrival: Nanos) -> Origins {
    let mut origins = Origins::NONE;
    for (hash, time) in chains.iter().filter(|(hash, _)| *hash != 0) {
        let at = TABLE
            .iter()
            .position(|known| known.load(Ordering::Relaxed) == *hash);
        let name = at.and_then(|at| u32::try_from(at + 1).ok());
        let Some((name, clocks)) = name.zip(clocks()) else {
            continue;
        };
        let instant = published_at(*time, arrival, clocks);
        if instant < arrival {
            origins.add(ChainName(name).came(), instant);
        }
    }
    origins
}

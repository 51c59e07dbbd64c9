//! CPU time and context switches of threads, as the kernel counts them.

use crate::load::Nanos;
use replenish_cli::outcome::Failure;
use replenish_cli::threads::all;
use replenish_os::Tid;
use replenish_os::clock::ThreadCpuClock;

/// CPU time of threads, and how often the threads blocked.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Used {
    /// CPU time.
    pub cpu: Nanos,
    /// Number of times that they blocked.
    pub voluntary_switches: u64,
}

impl Used {
    pub(super) fn since(&self, before: &Self) -> Self {
        Self {
            cpu: self.cpu.saturating_sub(before.cpu),
            voluntary_switches: self
                .voluntary_switches
                .saturating_sub(before.voluntary_switches),
        }
    }
}

/// The threads of these names in this process that are not among `others`, which are those of
/// another receiver.
pub(super) fn named(names: &[&str], others: &[Tid]) -> Result<Vec<Tid>, Failure> {
    let missing = |name: &str| Failure::refused(format!("no thread {name} in this process"));
    let new = |name: &str| all(name).into_iter().find(|tid| !others.contains(tid));
    let found = names
        .iter()
        .map(|name| new(name).ok_or_else(|| missing(name)));
    found.collect()
}

/// The threads that have these names already.
pub(super) fn known(names: &[&str]) -> Vec<Tid> {
    names.iter().flat_map(|name| all(name)).collect()
}

/// The sum over all `threads`, by the accounts of the kernel.
pub(super) fn used(threads: &[Tid]) -> Result<Used, Failure> {
    let mut sum = Used::default();
    for tid in threads {
        let cpu = ThreadCpuClock::of(*tid).read();
        sum.cpu += cpu.ok_or_else(|| Failure::refused(format!("thread {tid} has gone")))?;
        let status = std::fs::read_to_string(format!("/proc/self/task/{tid}/status"));
        let status = status.map_err(Failure::refused)?;
        let mut lines = status.lines();
        let switches = lines.find_map(|l| l.strip_prefix("voluntary_ctxt_switches:"));
        let switches = switches.and_then(|n| n.trim().parse::<u64>().ok());
        sum.voluntary_switches += switches.unwrap_or(0);
    }
    Ok(sum)
}

//! Sets of CPUs on which a thread may run.

use crate::Tid;
use rustix::process::Pid;
use rustix::thread::{self, sched_getaffinity, sched_setaffinity};
use std::fmt;
use std::io;

/// The most CPUs that a [`CpuSet`] can name.
const MAX_CPUS: usize = thread::CpuSet::MAX_CPU;

/// A set of CPU numbers, `0..1024`.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct CpuSet(thread::CpuSet);

impl CpuSet {
    /// The set with `cpu` alone; empty if `cpu` is 1024 or more.
    #[must_use]
    pub fn one(cpu: usize) -> Self {
        let mut set = Self::default();
        if cpu < MAX_CPUS {
            set.0.set(cpu);
        }
        set
    }

    /// The set a list like `0-3,7` names (the kernel's cpulist format); `None` if it is not one.
    /// An empty list is the empty set.
    #[must_use]
    pub fn parse(list: &str) -> Option<Self> {
        let mut set = Self::default();
        for part in list.trim().split(',').filter(|part| !part.is_empty()) {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last): (usize, usize) = (first.parse().ok()?, last.parse().ok()?);
            if last >= MAX_CPUS {
                return None;
            }
            (first..=last).for_each(|cpu| set.0.set(cpu));
        }
        Some(set)
    }

    /// Whether `cpu` is in the set.
    #[must_use]
    pub fn contains(&self, cpu: usize) -> bool {
        cpu < MAX_CPUS && self.0.is_set(cpu)
    }

    /// Number of CPUs in the set.
    #[must_use]
    pub fn len(&self) -> usize {
        self.iter().count()
    }

    /// Whether no CPU is in the set.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The CPU numbers in the set, ascending.
    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        (0..MAX_CPUS).filter(|cpu| self.contains(*cpu))
    }
}

/// Ranges as the kernel's cpulist format writes them: `0-3,7`.
impl fmt::Display for CpuSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut comma = "";
        for first in self.iter().filter(|c| *c == 0 || !self.contains(c - 1)) {
            let last = (first..MAX_CPUS)
                .take_while(|c| self.contains(*c))
                .last()
                .unwrap_or(first);
            if last == first {
                write!(f, "{comma}{first}")?;
            } else {
                write!(f, "{comma}{first}-{last}")?;
            }
            comma = ",";
        }
        Ok(())
    }
}

impl fmt::Debug for CpuSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CpuSet({self})")
    }
}

/// Lets thread `tid` run on the CPUs in `cpus` only (`sched_setaffinity(2)`).
///
/// # Errors
/// `EINVAL` if none of them is online and allowed by the cpuset, `ESRCH` if the thread has ended,
/// `EBUSY` for a `SCHED_DEADLINE` thread and less than its whole root domain.
pub fn set_affinity(tid: Tid, cpus: &CpuSet) -> io::Result<()> {
    Ok(sched_setaffinity(Pid::from_raw(tid.get()), &cpus.0)?)
}

/// The CPUs thread `tid` may run on (`sched_getaffinity(2)`).
///
/// # Errors
/// `ESRCH` if the thread has ended, `EINVAL` on a machine with more than 1024 CPUs.
pub fn affinity(tid: Tid) -> io::Result<CpuSet> {
    Ok(CpuSet(sched_getaffinity(Pid::from_raw(tid.get()))?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_prints_as_the_kernel_does() {
        let mut set = CpuSet::default();
        assert!(set.is_empty());
        for cpu in [0, 1, 2, 3, 7, 64] {
            set.0.set(cpu);
        }
        assert_eq!(set.to_string(), "0-3,7,64");
        assert_eq!(set.len(), 6);
        assert_eq!(CpuSet::one(MAX_CPUS - 1).to_string(), "1023");
        assert!(CpuSet::one(MAX_CPUS).is_empty());
        assert_eq!(CpuSet::parse("0-3,7,64\n"), Some(set));
        assert_eq!(CpuSet::parse(""), Some(CpuSet::default()));
        for bad in ["x", "1-", "1024", "0-18446744073709551615"] {
            assert_eq!(CpuSet::parse(bad), None, "{bad}");
        }
    }
}

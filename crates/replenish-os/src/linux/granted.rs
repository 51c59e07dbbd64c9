//! A thread's scheduling class and CPUs, read back from the kernel.

use super::affinity::{CpuSet, affinity};
use super::sched_attr;
use crate::Nanos;
use crate::Tid;
use sporadic::WholeUnits;
use std::fmt;
use std::io;

/// The scheduling of a thread as the kernel reports it (`sched_getattr(2)`,
/// `sched_getaffinity(2)`).
///
/// For a thread under an enforcer the priority is that of the moment. A boost by priority
/// inheritance does not show.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Granted {
    /// The scheduling class with its parameters.
    pub policy: GrantedPolicy,
    /// The real-time priority, 1 to 99; 0 in classes without one.
    pub priority: u8,
    /// The CPUs on which the thread may run.
    pub cpus: CpuSet,
    /// Whether children of the thread start in `SCHED_OTHER`.
    pub reset_on_fork: bool,
}

/// A scheduling class of Linux.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum GrantedPolicy {
    /// `SCHED_OTHER` with its nice value, -20 to 19.
    Other {
        /// The nice value.
        nice: i8,
    },
    /// `SCHED_FIFO`.
    Fifo,
    /// `SCHED_RR`.
    RoundRobin,
    /// `SCHED_DEADLINE`.
    Deadline {
        /// CPU time in every period, in nanoseconds.
        runtime: Nanos,
        /// The relative deadline in nanoseconds.
        deadline: Nanos,
        /// The period in nanoseconds.
        period: Nanos,
        /// Whether unused bandwidth of others is reclaimed.
        reclaim: bool,
    },
    /// Another class, by the kernel's number (`SCHED_BATCH` is 3, `SCHED_IDLE` 5).
    Unknown(u32),
}

/// Reads what thread `tid` has. Any thread may ask about any other.
///
/// # Errors
/// `ESRCH` if the thread has ended.
pub fn granted(tid: Tid) -> io::Result<Granted> {
    let attr = sched_attr::get(tid)?;
    let flag = |flag: libc::c_int| attr.sched_flags & u64::from(flag.cast_unsigned()) != 0;
    let policy = match libc::c_int::try_from(attr.sched_policy) {
        Ok(libc::SCHED_OTHER) => GrantedPolicy::Other {
            nice: i8::try_from(attr.sched_nice).unwrap_or(0),
        },
        Ok(libc::SCHED_FIFO) => GrantedPolicy::Fifo,
        Ok(libc::SCHED_RR) => GrantedPolicy::RoundRobin,
        Ok(libc::SCHED_DEADLINE) => GrantedPolicy::Deadline {
            runtime: attr.sched_runtime,
            deadline: attr.sched_deadline,
            period: attr.sched_period,
            reclaim: flag(libc::SCHED_FLAG_RECLAIM),
        },
        _ => GrantedPolicy::Unknown(attr.sched_policy),
    };
    Ok(Granted {
        policy,
        priority: u8::try_from(attr.sched_priority).unwrap_or(u8::MAX),
        cpus: affinity(tid)?,
        reset_on_fork: flag(libc::SCHED_FLAG_RESET_ON_FORK),
    })
}

/// `FIFO 60, CPU 1`; `OTHER, CPUs 0-1`; `DEADLINE 3 ms/10 ms/10 ms, CPUs 0-3`.
impl fmt::Display for Granted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.policy {
            GrantedPolicy::Other { nice: 0 } => f.write_str("OTHER")?,
            GrantedPolicy::Other { nice } => write!(f, "OTHER nice {nice}")?,
            GrantedPolicy::Fifo => write!(f, "FIFO {}", self.priority)?,
            GrantedPolicy::RoundRobin => write!(f, "RR {}", self.priority)?,
            GrantedPolicy::Deadline {
                runtime,
                deadline,
                period,
                reclaim,
            } => {
                let (runtime, deadline, period) = (
                    WholeUnits(runtime),
                    WholeUnits(deadline),
                    WholeUnits(period),
                );
                let reclaim = if reclaim { " reclaiming" } else { "" };
                write!(f, "DEADLINE {runtime}/{deadline}/{period}{reclaim}")?;
            }
            GrantedPolicy::Unknown(number) => write!(f, "scheduling class {number}")?,
        }
        let plural = if self.cpus.len() == 1 { "" } else { "s" };
        write!(f, ", CPU{plural} {}", self.cpus)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_granted_fits_a_table_cell() {
        let mut granted = Granted {
            policy: GrantedPolicy::Fifo,
            priority: 60,
            cpus: CpuSet::one(1),
            reset_on_fork: true,
        };
        assert_eq!(granted.to_string(), "FIFO 60, CPU 1");
        granted.policy = GrantedPolicy::Other { nice: 5 };
        assert_eq!(granted.to_string(), "OTHER nice 5, CPU 1");
        granted.policy = GrantedPolicy::Deadline {
            runtime: 3_000_000,
            deadline: 10_000_000,
            period: 10_000_000,
            reclaim: true,
        };
        assert_eq!(
            granted.to_string(),
            "DEADLINE 3 ms/10 ms/10 ms reclaiming, CPU 1"
        );
    }
}

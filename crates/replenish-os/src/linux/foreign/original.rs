//! Policy and CPUs of a foreign thread before it got a budget, and how it gets them back.

use super::processes::start_of;
use crate::Tid;
use crate::linux::affinity::{CpuSet, affinity, set_affinity};
use crate::linux::sched_attr;
use std::fmt;
use std::io;
use std::str::FromStr;

/// The scheduling of a thread: policy, nice value, priority, reset-on-fork flag and CPUs.
///
/// Its text form is one line of words, for a process that gives the policies back after this one
/// was killed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Original {
    policy: u32,
    flags: u64,
    nice: i32,
    priority: u32,
    runtime: u64,
    deadline: u64,
    period: u64,
    cpus: CpuSet,
}

impl Original {
    /// The policy and CPUs of thread `tid` at this moment.
    ///
    /// # Errors
    /// `ESRCH` if the thread has ended.
    pub fn of(tid: Tid) -> io::Result<Self> {
        let attr = sched_attr::get(tid)?;
        Ok(Self {
            policy: attr.sched_policy,
            flags: attr.sched_flags & u64::from(libc::SCHED_FLAG_RESET_ON_FORK.cast_unsigned()),
            nice: attr.sched_nice,
            priority: attr.sched_priority,
            runtime: attr.sched_runtime,
            deadline: attr.sched_deadline,
            period: attr.sched_period,
            cpus: affinity(tid)?,
        })
    }

    /// Gives it to thread `tid`. Both the policy and the CPUs are tried, whatever becomes of one.
    ///
    /// # Errors
    /// `ESRCH` if the thread has ended, `EPERM` without the privilege.
    pub fn apply(&self, tid: Tid) -> io::Result<()> {
        let policy = sched_attr::set(tid, &self.attr());
        let placed = set_affinity(tid, &self.cpus);
        policy.and(placed)
    }

    fn attr(&self) -> libc::sched_attr {
        libc::sched_attr {
            sched_policy: self.policy,
            sched_flags: self.flags,
            sched_nice: self.nice,
            sched_priority: self.priority,
            sched_runtime: self.runtime,
            sched_deadline: self.deadline,
            sched_period: self.period,
            ..sched_attr::empty()
        }
    }

    /// The CPUs that it allows.
    #[must_use]
    pub fn cpus(&self) -> &CpuSet {
        &self.cpus
    }

    /// Whether the kernel schedules such a thread by a reservation of its own.
    pub(super) fn is_deadline(&self) -> bool {
        i32::try_from(self.policy) == Ok(libc::SCHED_DEADLINE)
    }

    /// The real-time priority that it gives; 0 for none.
    #[must_use]
    pub fn priority(&self) -> u32 {
        self.priority
    }

    /// The policy and CPUs without those that a thread inherited from an enforced creator.
    ///
    /// `self` was found at a thread that began under an enforcer on `cpu`, in a program whose first
    /// thread had `first`. A thread inherits its creator's CPU, and the class of the background:
    /// neither is its own.
    #[must_use]
    pub fn without_inheritance(self, cpu: usize, first: &Self) -> Self {
        let inherited = match i32::try_from(self.policy) {
            Ok(libc::SCHED_IDLE) => true,
            Ok(libc::SCHED_OTHER) => self.nice == 0,
            _ => false,
        };
        if inherited && self.cpus == CpuSet::one(cpu) {
            *first
        } else {
            self
        }
    }
}

/// Gives thread `tid` back what it had, if it is still the thread that began at `start`
/// ([`ForeignThread::start`](super::ForeignThread::start)). Returns whether it is.
///
/// # Errors
/// As [`Original::apply`], except that a thread that has ended is no error.
pub fn restore(tid: Tid, start: u64, original: &Original) -> io::Result<bool> {
    if start_of(tid) != Some(start) {
        return Ok(false);
    }
    match original.apply(tid) {
        Err(e) if e.raw_os_error() == Some(libc::ESRCH) => Ok(false),
        done => done.map(|()| true),
    }
}

impl fmt::Display for Original {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            policy,
            flags,
            nice,
            priority,
            runtime,
            deadline,
            period,
            cpus,
        } = self;
        write!(
            f,
            "{policy} {flags} {nice} {priority} {runtime} {deadline} {period} {cpus}"
        )
    }
}

/// The text is not what [`Original`] prints.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct NotAnOriginal;

impl fmt::Display for NotAnOriginal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("expected policy, flags, nice, priority, runtime, deadline, period and CPUs")
    }
}

impl std::error::Error for NotAnOriginal {}

impl FromStr for Original {
    type Err = NotAnOriginal;

    fn from_str(text: &str) -> Result<Self, NotAnOriginal> {
        fn next<T: FromStr>(words: &mut std::str::SplitWhitespace<'_>) -> Result<T, NotAnOriginal> {
            let word = words.next().ok_or(NotAnOriginal)?;
            word.parse().map_err(|_| NotAnOriginal)
        }
        let words = &mut text.split_whitespace();
        let original = Self {
            policy: next(words)?,
            flags: next(words)?,
            nice: next(words)?,
            priority: next(words)?,
            runtime: next(words)?,
            deadline: next(words)?,
            period: next(words)?,
            cpus: words
                .next()
                .and_then(CpuSet::parse)
                .filter(|cpus| !cpus.is_empty())
                .ok_or(NotAnOriginal)?,
        };
        match words.next() {
            None => Ok(original),
            Some(_) => Err(NotAnOriginal),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::current_tid;

    #[test]
    fn its_text_reads_back_and_nothing_else_does() {
        let mine = Original::of(current_tid()).unwrap();
        assert_eq!(mine.to_string().parse(), Ok(mine));
        for bad in [
            "",
            "0",
            "0 0 0 0 0 0 0",
            "0 0 0 0 0 0 0 x",
            "0 0 0 0 0 0 0 0 1",
        ] {
            assert_eq!(bad.parse::<Original>(), Err(NotAnOriginal), "{bad:?}");
        }
    }

    #[test]
    fn a_thread_with_another_beginning_is_left_alone() {
        let (tid, mine) = (current_tid(), Original::of(current_tid()).unwrap());
        let start = start_of(tid).unwrap();
        assert!(restore(tid, start, &mine).unwrap());
        assert!(!restore(tid, start + 1, &mine).unwrap());
        assert!(!restore(Tid::new(i32::MAX).unwrap(), start, &mine).unwrap());
    }
}

//! Reasons why a foreign thread gets no budget.

use crate::Tid;
use std::fmt;
use std::io;

/// Reason why a foreign thread could not be enrolled, or a budget not be made.
#[derive(Debug)]
#[non_exhaustive]
pub enum ForeignError {
    /// There is no such thread, or it has ended meanwhile.
    Gone {
        /// The number that was asked for.
        tid: Tid,
    },
    /// The thread belongs to this very process.
    Own {
        /// The thread.
        tid: Tid,
    },
    /// The thread belongs to another process.
    NotOwn {
        /// The thread.
        tid: Tid,
    },
    /// The thread has a real-time priority that the enforcer could not interrupt.
    Above {
        /// The thread.
        tid: Tid,
        /// Its priority.
        priority: u32,
    },
    /// The thread is one of the kernel's.
    Kernel {
        /// The thread.
        tid: Tid,
    },
    /// The thread has a reservation of the kernel's (`SCHED_DEADLINE`).
    Deadline {
        /// The thread.
        tid: Tid,
    },
    /// The thread is enrolled already.
    Enrolled {
        /// The thread.
        tid: Tid,
    },
    /// The thread is a worker of an executor of this process.
    Worker {
        /// The thread.
        tid: Tid,
    },
    /// The enforcer's thread has ended: it could not read its timer.
    NoEnforcer,
    /// There is no place left.
    Full {
        /// The kind that has no place left: threads, or budgets.
        what: &'static str,
        /// The most of this kind.
        capacity: usize,
    },
    /// The priority is not below the enforcer's.
    Priority {
        /// The FIFO priority that was asked for.
        value: u8,
        /// The enforcer's.
        enforcer: u8,
    },
    /// The background is no class that a thread can be lowered to.
    Background {
        /// The priority that the background must be below.
        priority: u8,
    },
    /// The budget's parameters do not fit.
    Params(sporadic::ParamError),
    /// The kernel refused a change of the thread.
    Refused {
        /// The thread.
        tid: Tid,
        /// The property that was to be changed: the policy, the CPU.
        what: &'static str,
        /// The kernel's error.
        source: io::Error,
    },
}

impl ForeignError {
    /// Whether the reason is a missing privilege.
    #[must_use]
    pub fn is_permission(&self) -> bool {
        matches!(self, Self::Refused { source, .. }
            if source.kind() == io::ErrorKind::PermissionDenied)
    }

    /// Whether the thread has ended, which is no mistake of the caller.
    #[must_use]
    pub fn is_gone(&self) -> bool {
        match self {
            Self::Gone { .. } => true,
            Self::Refused { source, .. } => source.raw_os_error() == Some(libc::ESRCH),
            _ => false,
        }
    }
}

impl fmt::Display for ForeignError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gone { tid } => write!(f, "there is no thread {tid}"),
            Self::Own { tid } => write!(
                f,
                "thread {tid} belongs to this process: a program gives its own threads budgets by \
                 its executor"
            ),
            Self::NotOwn { tid } => write!(
                f,
                "thread {tid} belongs to another process: `replenish adopt` gives it a budget"
            ),
            Self::Above { tid, priority } => write!(
                f,
                "thread {tid} has real-time priority {priority}, which is not below the enforcer's: \
                 lower it first"
            ),
            Self::Kernel { tid } => write!(f, "thread {tid} is one of the kernel's"),
            Self::Deadline { tid } => write!(
                f,
                "thread {tid} has a reservation of the kernel (SCHED_DEADLINE) and keeps it"
            ),
            Self::Enrolled { tid } => write!(f, "thread {tid} has a budget already"),
            Self::Worker { tid } => {
                write!(
                    f,
                    "thread {tid} is a worker and has the budget of its executor"
                )
            }
            Self::NoEnforcer => write!(
                f,
                "the enforcer could not read its timer and has ended: start the program anew"
            ),
            Self::Full { what, capacity } => {
                write!(f, "the enforcer has room for {capacity} {what}, all taken")
            }
            Self::Priority { value, enforcer } => write!(
                f,
                "priority {value} is out of range: allowed 1 to {} (below the enforcer)",
                enforcer.saturating_sub(1)
            ),
            Self::Background { priority } => write!(
                f,
                "the background is out of range: allowed idle, other, or a FIFO priority from 1 to \
                 {} (below priority {priority})",
                priority.saturating_sub(1)
            ),
            Self::Params(e) => e.fmt(f),
            Self::Refused { tid, what, source } => {
                write!(
                    f,
                    "the kernel refuses to change the {what} of thread {tid}: {source}"
                )
            }
        }
    }
}

impl std::error::Error for ForeignError {}

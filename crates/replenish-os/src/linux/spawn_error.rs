//! Reasons why a thread could not be started as asked: what was asked, what the kernel answered,
//! and what would grant it.

use super::affinity::CpuSet;
use super::privilege::{Privilege, probe};
use crate::{Policy, PolicyError};
use std::fmt;
use std::io;

/// Reason why [`spawn`](crate::spawn) did not start a thread.
#[derive(Debug)]
#[non_exhaustive]
pub enum SpawnError {
    /// A parameter of the policy is out of its range.
    Parameter(PolicyError),
    /// The name contains a NUL byte.
    Name,
    /// A deadline policy together with a CPU: the kernel does not take both.
    PinnedDeadline {
        /// The CPU that was asked for.
        cpu: usize,
    },
    /// The thread itself could not be made (memory, number of threads).
    Create(io::Error),
    /// The CPU does not exist, is offline, or is not one this process may use.
    Cpu {
        /// The CPU that was asked for.
        cpu: usize,
        /// CPUs that this process may use.
        allowed: Box<CpuSet>,
        /// The kernel's answer.
        source: io::Error,
    },
    /// The kernel refused the policy.
    Policy {
        /// The policy that was asked for.
        policy: Policy,
        /// The kernel's answer.
        source: io::Error,
        /// The way to have it granted, in one or more lines.
        hint: String,
    },
}

impl SpawnError {
    /// Looks around for the reason of the kernel's answer `source`.
    pub(super) fn policy(policy: Policy, source: io::Error) -> Self {
        let hint = hint(policy, &source);
        Self::Policy {
            policy,
            source,
            hint,
        }
    }

    /// Whether the reason is missing privilege, so that a fallback without it makes sense.
    #[must_use]
    pub fn is_permission(&self) -> bool {
        matches!(self, Self::Policy { source, .. }
            if source.kind() == io::ErrorKind::PermissionDenied)
    }
}

fn hint(policy: Policy, source: &io::Error) -> String {
    if let Policy::KernelSporadic(_) = policy {
        return "Linux has no SCHED_SPORADIC; SPORADIC is held by an enforcer".into();
    }
    let deadline = matches!(policy, Policy::Deadline { .. });
    match source.raw_os_error() {
        Some(libc::EPERM) => permission_hint(deadline, &probe()),
        Some(libc::EBUSY) if deadline => {
            "the reservations of all SCHED_DEADLINE threads together would exceed what the kernel \
             admits (95 % of the CPUs unless kernel.sched_rt_runtime_us says otherwise): ask for \
             less runtime or a longer period"
                .into()
        }
        Some(libc::EINVAL) if deadline => {
            "the period must lie between kernel.sched_deadline_period_min_us and _max_us \
             (100 us and 4.19 s unless changed)"
                .into()
        }
        _ => "no advice for this answer".into(),
    }
}

fn permission_hint(deadline: bool, privilege: &Privilege) -> String {
    if deadline && privilege.cap_sys_nice {
        return "SCHED_DEADLINE needs a thread that may run on every CPU of its scheduling domain: \
                start the process without taskset or cpuset"
            .into();
    }
    if deadline && privilege.fifo.is_ok() {
        return format!(
            "SCHED_DEADLINE needs CAP_SYS_NICE; RLIMIT_RTPRIO does not help\n{}",
            super::privilege::setcap_line()
        );
    }
    privilege.to_string()
}

impl From<PolicyError> for SpawnError {
    fn from(e: PolicyError) -> Self {
        Self::Parameter(e)
    }
}

impl fmt::Display for SpawnError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parameter(e) => e.fmt(f),
            Self::Name => f.write_str("thread name contains a NUL byte"),
            Self::PinnedDeadline { cpu } => write!(
                f,
                "CPU {cpu} and a DEADLINE policy were asked for: the kernel answers EPERM to a \
                 pinned SCHED_DEADLINE thread; leave the CPU out, or use SPORADIC or FIFO"
            ),
            Self::Create(e) => write!(f, "the kernel makes no thread: {e}"),
            Self::Cpu {
                cpu,
                allowed,
                source,
            } => {
                write!(
                    f,
                    "CPU {cpu} was refused ({source}): this process may use {allowed}"
                )
            }
            Self::Policy {
                policy,
                source,
                hint,
            } => {
                write!(f, "policy {policy} was refused: {source}\n{hint}")
            }
        }
    }
}

impl std::error::Error for SpawnError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Parameter(e) => Some(e),
            Self::Create(e) | Self::Cpu { source: e, .. } | Self::Policy { source: e, .. } => {
                Some(e)
            }
            Self::Name | Self::PinnedDeadline { .. } => None,
        }
    }
}

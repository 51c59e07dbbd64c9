//! Reasons why a task could not be started as asked.

use super::error::OsError;
use crate::{Policy, PolicyError};
use core::fmt;

/// Reason why [`spawn`](crate::spawn) did not start a task.
#[derive(Debug)]
#[non_exhaustive]
pub enum SpawnError {
    /// A parameter of the policy is out of its range.
    Parameter(PolicyError),
    /// The name contains a NUL byte.
    Name,
    /// The task itself could not be made.
    Create(OsError),
    /// The kernel has no such policy.
    Unsupported(Policy),
    /// There is one CPU, number 0.
    Cpu {
        /// The CPU that was asked for.
        cpu: usize,
    },
}

impl SpawnError {
    /// Whether the reason is missing privilege: never here.
    #[must_use]
    pub const fn is_permission(&self) -> bool {
        false
    }
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
            Self::Create(e) => write!(f, "the kernel makes no task: {e}"),
            Self::Unsupported(policy) => {
                write!(f, "policy {policy}: {}", crate::backend::port::POLICIES)
            }
            Self::Cpu { cpu } => write!(f, "CPU {cpu} was asked for: allowed 0, there is one"),
        }
    }
}

impl core::error::Error for SpawnError {}

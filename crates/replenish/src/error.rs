//! What can go wrong while an executor is set up and started. Nothing here happens while it spins.

use crate::middleware::MiddlewareError;
use crate::name::NameError;
use crate::platform::{Text, text};
use core::fmt;
use replenish_os::{ParamError, PolicyError};

/// Setting up or starting failed; the message names the thing, the field and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// A name that ROS does not allow.
    Name(NameError),
    /// A parameter outside its range.
    Parameter {
        /// Whose parameter: `worker "high"`, `topic /scan`, `executor`.
        owner: Text,
        /// Its name, as in the API.
        field: &'static str,
        /// The value it was given.
        value: Text,
        /// What is allowed.
        allowed: Text,
    },
    /// A policy's parameter out of its range, from [`Policy`](crate::Policy)'s constructors.
    Policy(PolicyError),
    /// Two workers have the same name.
    DuplicateWorker(Text),
    /// No worker has this name.
    UnknownWorker(Text),
    /// No handle has this id.
    UnknownHandle(Text),
    /// A limit that was fixed at set-up is reached.
    Capacity {
        /// Of what there may be no more.
        what: Text,
        /// How many there may be.
        limit: usize,
    },
    /// The callback has not ended in time; its handle goes when it has. Its removal can be asked
    /// for again, as often as one likes, until it has gone ([`UnknownHandle`](Self::UnknownHandle)
    /// then, and while another thread waits for it).
    StillRunning(Text),
    /// The executor has stopped.
    Stopped,
    /// A worker without any handle.
    IdleWorker(Text),
    /// A node of another context than the executor's.
    ForeignNode(Text),
    /// Another executor spins this context.
    ContextBusy,
    /// No connection to the middleware's peer.
    Connect {
        /// Why.
        reason: Text,
    },
    /// The middleware could not create an endpoint.
    Middleware {
        /// Which one.
        endpoint: Text,
        /// Why.
        source: MiddlewareError,
    },
    /// A thread could not be started.
    Thread {
        /// Its name.
        name: Text,
        /// Why.
        reason: Text,
    },
    /// A guarantee does not fit on this host, or would break what another program was promised.
    NotAdmitted {
        /// One sentence: who does not fit, where and why, and what would fit.
        reason: Text,
    },
    /// A deployment file that cannot be applied.
    Overlay {
        /// The place, the field, and what is allowed.
        reason: Text,
    },
    /// `strict` is set and a guarantee cannot be given.
    NotGranted {
        /// What was asked for.
        what: Text,
        /// Why it is refused, and how to get it.
        reason: Text,
    },
}

impl Error {
    pub(crate) fn parameter(
        owner: impl Into<Text>,
        field: &'static str,
        value: &dyn fmt::Display,
        allowed: impl Into<Text>,
    ) -> Self {
        Self::Parameter {
            owner: owner.into(),
            field,
            value: text!("{value}"),
            allowed: allowed.into(),
        }
    }

    pub(crate) fn endpoint(kind: &str, topic: &str, source: MiddlewareError) -> Self {
        Self::Middleware {
            endpoint: text!("{kind} {topic}"),
            source,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(e) => e.fmt(f),
            Self::Parameter {
                owner,
                field,
                value,
                allowed,
            } => write!(f, "{owner}: {field} = {value} is not allowed: {allowed}"),
            Self::Policy(e) => e.fmt(f),
            Self::DuplicateWorker(name) => write!(f, "there are two workers named {name:?}"),
            Self::IdleWorker(name) => {
                write!(f, "worker {name:?} has no handle and no capacity for any")
            }
            Self::UnknownWorker(name) => write!(f, "there is no worker named {name:?}"),
            Self::UnknownHandle(id) => write!(f, "there is no handle {id}"),
            Self::Capacity { what, limit } => write!(f, "too many {what}: the limit is {limit}"),
            Self::StillRunning(id) => write!(f, "{id}: its callback has not ended in time"),
            Self::Stopped => f.write_str("the executor has stopped"),
            Self::ForeignNode(node) => {
                write!(
                    f,
                    "node {node} belongs to another context than the executor"
                )
            }
            Self::ContextBusy => f.write_str("another executor spins this context"),
            Self::Connect { reason } => f.write_str(reason),
            Self::Middleware { endpoint, source } => write!(f, "{endpoint}: {source}"),
            Self::Thread { name, reason } => write!(f, "thread {name:?}: {reason}"),
            Self::NotAdmitted { reason } => write!(f, "not admitted: {reason}"),
            Self::Overlay { reason } => f.write_str(reason),
            Self::NotGranted { what, reason } => write!(f, "{what} cannot be granted: {reason}"),
        }
    }
}

impl core::error::Error for Error {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Name(e) => Some(e),
            Self::Policy(e) => Some(e),
            Self::Middleware { source, .. } => Some(source),
            _ => None,
        }
    }
}

impl From<NameError> for Error {
    fn from(e: NameError) -> Self {
        Self::Name(e)
    }
}

impl From<PolicyError> for Error {
    fn from(e: PolicyError) -> Self {
        Self::Policy(e)
    }
}

impl From<ParamError> for Error {
    fn from(e: ParamError) -> Self {
        Self::Policy(e.into())
    }
}

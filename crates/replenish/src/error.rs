//! The error of a program: set-up and start fail with it, and all other errors become it.

use crate::action::goal_error::GoalError;
use crate::lifecycle::error::LifecycleError;
use crate::middleware::{MiddlewareError, PublishError};
use crate::name::NameError;
use crate::parameter::{ParameterError, ParameterErrorKind};
use crate::platform::{TEXTS, Text, text};
use crate::service::error::{CallError, NoReply};
use core::fmt;
use replenish_os::{ParamError, PolicyError};

/// An error of replenish: one sentence that names the thing, the field, what is allowed, and the
/// way out.
///
/// `{}` and `{:?}` print the same, so that a `main` that returns it shows the sentence. Every other
/// public error of this crate becomes one with `?`.
///
/// ```
/// let error = replenish::Context::in_process().node("my robot").unwrap_err();
/// assert_eq!(format!("{error:?}"), error.to_string());
/// ```
#[derive(Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// A name that ROS does not allow.
    Name(NameError),
    /// A parameter outside its range.
    Parameter {
        /// The owner of the parameter: `worker "high"`, `topic /scan`, `executor`.
        owner: Text,
        /// The parameter's name, as in the API.
        field: &'static str,
        /// The value that the parameter was given.
        value: Text,
        /// The allowed range.
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
        /// The limited things, as `handles of worker "high"`.
        what: Text,
        /// The most of them at a time.
        limit: usize,
    },
    /// The callback has not ended in time; its handle goes when it has. The removal can be repeated
    /// until the handle has gone. It is an [`UnknownHandle`](Self::UnknownHandle) then, and while
    /// another thread waits for it.
    StillRunning(Text),
    /// The executor has stopped.
    Stopped,
    /// A worker without any handle.
    IdleWorker(Text),
    /// A node of another context than the executor's.
    ForeignNode(Text),
    /// Another executor spins this context.
    ContextBusy,
    /// The middleware's peer cannot be reached.
    Connect {
        /// Why.
        reason: Text,
    },
    /// The middleware could not create an endpoint.
    Middleware {
        /// The endpoint that was not created.
        endpoint: Text,
        /// The middleware's reason.
        source: MiddlewareError,
    },
    /// A thread could not be started.
    Thread {
        /// The thread's name.
        name: Text,
        /// Why.
        reason: Text,
    },
    /// A guarantee that contradicts itself.
    Guarantee {
        /// The worker, the field in the user's words, and what is allowed.
        reason: Text,
    },
    /// A guarantee does not fit on this host, or would break what another program was promised.
    NotAdmitted {
        /// One sentence: the worker that does not fit, its CPU and the reason, and requests that
        /// would fit.
        reason: Text,
    },
    /// An argument or a variable of the program that cannot be used.
    Arguments {
        /// The argument's place, the argument, and what is allowed.
        reason: Text,
    },
    /// A deployment file that cannot be applied.
    Overlay {
        /// The place, the field, and what is allowed.
        reason: Text,
    },
    /// `strict` is set and a guarantee cannot be given.
    NotGranted {
        /// The request.
        what: Text,
        /// The reason why it is refused, and how to get it.
        reason: Text,
    },
    /// A sample was not sent.
    Publish(PublishError),
    /// A request was not sent.
    Call(CallError),
    /// A request got no reply.
    NoReply(NoReply),
    /// Something could not be done to a goal.
    Goal(GoalError),
    /// A transition was not made.
    Lifecycle(LifecycleError),
    /// A parameter of a node was not declared, read or set.
    NodeParameter {
        /// The kind of the error.
        kind: ParameterErrorKind,
        /// The parameter, and what is allowed.
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
            Self::Middleware { endpoint, source } => write!(f, "{endpoint}: {source}"),
            Self::Thread { name, reason } => write!(f, "thread {name:?}: {reason}"),
            Self::Arguments { reason }
            | Self::Connect { reason }
            | Self::Guarantee { reason }
            | Self::NotAdmitted { reason }
            | Self::Overlay { reason } => f.write_str(reason),
            Self::NotGranted { what, reason } => write!(f, "{what} cannot be granted: {reason}"),
            _ => self.operation(f),
        }
    }
}

impl Error {
    /// The errors of running programs; a board without texts has no room for the sentences.
    fn operation(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            _ if !TEXTS => f.write_str("failed"),
            Self::Publish(e) => fmt::Display::fmt(e, f),
            Self::Call(e) => fmt::Display::fmt(e, f),
            Self::NoReply(e) => fmt::Display::fmt(e, f),
            Self::Goal(e) => fmt::Display::fmt(e, f),
            Self::Lifecycle(e) => fmt::Display::fmt(e, f),
            Self::NodeParameter { reason, .. } => f.write_str(reason),
            _ => Ok(()), // has been printed
        }
    }
}

/// The sentence: this is how `main` prints the error that it returns.
impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Without a source: the sentence says it all, and printers of chains would say parts of it twice.
impl core::error::Error for Error {}

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

impl From<MiddlewareError> for Error {
    fn from(e: MiddlewareError) -> Self {
        Self::endpoint("the", "middleware", e)
    }
}

impl From<PublishError> for Error {
    fn from(e: PublishError) -> Self {
        Self::Publish(e)
    }
}

impl From<CallError> for Error {
    fn from(e: CallError) -> Self {
        Self::Call(e)
    }
}

impl From<NoReply> for Error {
    fn from(e: NoReply) -> Self {
        Self::NoReply(e)
    }
}

impl From<GoalError> for Error {
    fn from(e: GoalError) -> Self {
        Self::Goal(e)
    }
}

impl From<LifecycleError> for Error {
    fn from(e: LifecycleError) -> Self {
        Self::Lifecycle(e)
    }
}

impl From<ParameterError> for Error {
    fn from(e: ParameterError) -> Self {
        Self::NodeParameter {
            kind: e.kind(),
            reason: e.reason().into(),
        }
    }
}

//! Events that an executor reports while it runs: rare, and never on the ordinary path.
//!
//! Everything here is also counted in the [`Report`](crate::Report). Events that can happen for
//! every sample are reported the first time and then whenever their count doubles.

use crate::middleware::{IncompatibleQos, MiddlewareError};
use core::fmt;
use replenish_msg::DecodeError;

/// Something worth a line in the log.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A guarantee that was asked for is not in force; at the start, `strict` would have made it an
    /// error. While the executor runs it comes from the watchdog of the enforcers, on a thread of
    /// its own, see `replenish_os::Fault`.
    Fallback {
        /// The missing mechanism, its substitute, and the way to get it.
        message: &'a str,
    },
    /// A callback returned an error.
    CallbackFailed {
        /// The handle's id.
        handle: &'a str,
        /// The error.
        error: &'a dyn fmt::Display,
        /// Number of errors of this handle so far.
        count: u64,
    },
    /// A callback panicked; its handle has stopped. For a custom [trigger](crate::Trigger::Custom),
    /// whose id is `worker/trigger`, its worker has stopped.
    CallbackPanicked {
        /// The handle's id.
        handle: &'a str,
        /// The panic's message.
        message: &'a str,
    },
    /// A sample could not be decoded.
    Undecodable {
        /// The handle's id.
        handle: &'a str,
        /// Why, and in which field.
        error: DecodeError,
        /// Number of this handle's samples that could not be decoded so far.
        count: u64,
    },
    /// A sample, request or reply was larger than its handle takes: the type's usual size, what
    /// [`Topic::max_size`](crate::Topic::max_size) says, or for parameters
    /// [`ParameterOptions::max_size`](crate::ParameterOptions::max_size).
    Oversize {
        /// The handle's id.
        handle: &'a str,
        /// Bytes of the sample.
        size: usize,
        /// Number of this handle's samples that were too large so far.
        count: u64,
    },
    /// A callback waits for its [group](crate::Group) longer than the group's
    /// [patience](crate::Group::patience). If `by` waits for `handle` in turn, both wait for ever.
    Blocked {
        /// The handle that waits.
        handle: &'a str,
        /// The group's name.
        group: &'a str,
        /// The handle whose callback runs.
        by: &'a str,
        /// Its wait so far, in ns.
        waited: crate::Nanos,
    },
    /// A callback has needed more CPU time than it [may hold](crate::Group::holds) its group:
    /// workers with a guarantee may have waited longer than was promised.
    HeldTooLong {
        /// The handle's id.
        handle: &'a str,
        /// The group's name.
        group: &'a str,
        /// The stated CPU time, in ns.
        stated: crate::Nanos,
        /// The CPU time that it needed, in ns.
        held: crate::Nanos,
        /// Number of callbacks of the group that needed too much so far.
        count: u64,
    },
    /// An instance of a [chain](crate::Executor::chain) took longer than its limit.
    ChainExceeded {
        /// The chain's name.
        chain: &'a str,
        /// Time from its origin to the end of the last stage, in ns.
        latency: crate::Nanos,
        /// The limit, in ns.
        limit: crate::Nanos,
        /// Number of instances of this chain that took too long so far.
        count: u64,
    },
    /// The middleware could not wait or take; the dispatcher tries again.
    MiddlewareFailed {
        /// The middleware's error.
        error: &'a MiddlewareError,
        /// Number of failures of the middleware so far.
        count: u64,
    },
    /// An endpoint does not talk with another of its topic because of the quality of service of
    /// both: nothing of what the one publishes reaches the other.
    Incompatible {
        /// The handle's id; `publisher` and the topic, or `client` and the service.
        endpoint: &'a str,
        /// The policies that do not fit each other.
        clash: &'a IncompatibleQos,
    },
    /// The link to the peer went down or came back.
    Link {
        /// Whether samples can be exchanged now.
        up: bool,
    },
    /// A thread of the executor itself panicked: a defect of replenish or of the middleware. The
    /// executor stops.
    ThreadPanicked {
        /// The thread's name.
        thread: &'a str,
    },
    /// A thread has not ended in time after a stop; it was demoted and left behind.
    Stuck {
        /// The thread's name.
        thread: &'a str,
    },
}

impl fmt::Display for Event<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fallback { message } => f.write_str(message),
            Self::CallbackFailed {
                handle,
                error,
                count,
            } => {
                write!(f, "{handle}: callback failed ({count} times): {error}")
            }
            Self::CallbackPanicked { handle, message } => {
                write!(
                    f,
                    "{handle}: callback panicked, the handle has stopped: {message}"
                )
            }
            Self::Undecodable {
                handle,
                error,
                count,
            } => {
                write!(
                    f,
                    "{handle}: sample cannot be decoded ({count} times): {error}"
                )
            }
            Self::Oversize {
                handle,
                size,
                count,
            } => {
                write!(
                    f,
                    "{handle}: sample of {size} bytes does not fit ({count} times): see max_size"
                )
            }
            Self::Blocked {
                handle,
                group,
                by,
                waited,
            } => {
                let ms = waited / 1_000_000;
                write!(
                    f,
                    "{handle}: has waited {ms} ms for group {group:?}, which {by} does not leave"
                )
            }
            Self::HeldTooLong {
                handle,
                group,
                stated,
                held,
                count,
            } => {
                let (stated, held) = (stated / 1000, held / 1000);
                write!(
                    f,
                    "{handle}: has held group {group:?} for {held} us of CPU time, {stated} us are stated ({count} times)"
                )
            }
            Self::ChainExceeded {
                chain,
                latency,
                limit,
                count,
            } => {
                let (latency, limit) = (latency / 1000, limit / 1000);
                write!(
                    f,
                    "chain {chain:?} took {latency} us, its limit is {limit} us ({count} times)"
                )
            }
            Self::MiddlewareFailed { error, count } => {
                write!(f, "middleware failed ({count} times): {error}")
            }
            Self::Incompatible { endpoint, clash } => write!(f, "{endpoint}: {clash}"),
            Self::Link { up: true } => f.write_str("link is up"),
            Self::Link { up: false } => f.write_str("link is down"),
            Self::ThreadPanicked { thread } => {
                write!(f, "thread {thread} panicked outside a callback; stopping")
            }
            Self::Stuck { thread } => {
                write!(f, "{thread} has not ended in time; demoted and left behind")
            }
        }
    }
}

impl fmt::Debug for Event<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Event({self})")
    }
}

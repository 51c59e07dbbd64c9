//! Names a topic, service or action for an endpoint, with the size of its messages.

use crate::error::Error;
use crate::platform::{STD, text};
use crate::qos::IngressLimit;
use alloc::string::String;

/// A topic, service or action as one of its ends asks for it: its name, and how large its messages
/// may be. A subscription has bounds on what comes besides.
///
/// ```
/// use replenish::Topic;
/// let camera = Topic::named("image").max_size(2_000_000);
/// let usual: Topic = "text".into();
/// # let _ = (camera, usual);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Topic<'a> {
    pub(crate) name: &'a str,
    pub(crate) max_size: Option<usize>,
    pub(crate) ingress: IngressLimit,
    pub(crate) keep_oldest: bool,
}

impl<'a> Topic<'a> {
    /// The topic of this name, expanded against the node's name.
    #[must_use]
    pub const fn named(name: &'a str) -> Self {
        Self {
            name,
            max_size: None,
            ingress: IngressLimit::none(),
            keep_oldest: false,
        }
    }

    /// Messages of up to this many bytes instead of `Message::MAX_SIZE`: 1 ≤ `bytes` ≤ `MAX_SIZE`,
    /// or 268435456 (256 MiB) for a type with unbounded fields (`Message::BOUNDED` says which).
    ///
    /// An endpoint takes memory for as many samples of this size as its depth says, at most 1 GiB,
    /// when it is made. A larger message is an error at its publisher; a subscription drops, counts
    /// and reports it. A service's requests and responses are meant, each of its own; an action's
    /// goals, results and feedback, the 16 bytes of the goal's id included. Their two ends each say
    /// the size. An action's server keeps one result of this size for each of its goals.
    #[must_use]
    pub const fn max_size(self, bytes: usize) -> Self {
        Self {
            max_size: Some(bytes),
            ..self
        }
    }

    /// The rate that the peer may send, so that a flood is stopped before it reaches this machine.
    #[must_use]
    pub const fn ingress_limit(self, limit: IngressLimit) -> Self {
        Self {
            ingress: limit,
            ..self
        }
    }

    /// Refuses what a subscription alone can have.
    pub(crate) fn check_plain(
        &self,
        kind: &str,
        name: &str,
        allowed: &'static str,
    ) -> Result<(), Error> {
        if STD && (self.keep_oldest || self.ingress != IngressLimit::none()) {
            let (owner, field) = (text!("{kind} {name}"), "keep_oldest, ingress_limit");
            return Err(Error::parameter(owner, field, &"set", allowed));
        }
        Ok(())
    }

    /// Keeps the oldest samples, with keep-last history: while `depth` samples wait, the *new* one
    /// is dropped (and counted). Usually the oldest makes room.
    #[must_use]
    pub const fn keep_oldest(self) -> Self {
        Self {
            keep_oldest: true,
            ..self
        }
    }
}

impl<'a> From<&'a String> for Topic<'a> {
    fn from(name: &'a String) -> Self {
        Self::named(name)
    }
}

impl<'a> From<&'a str> for Topic<'a> {
    fn from(name: &'a str) -> Self {
        Self::named(name)
    }
}

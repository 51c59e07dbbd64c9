//! How a subscription asks for its topic, and a service or client for its messages' size.

use crate::qos::IngressLimit;
use alloc::string::String;

/// A topic as a subscription asks for it: its name, and possibly bounds on what comes. A service or
/// client has a name and a size alone.
///
/// ```
/// use replenish::Topic;
/// let small = Topic::named("text").max_size(64);
/// let usual: Topic = "text".into();
/// # let _ = (small, usual);
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

    /// Slots of this many bytes instead of `Message::MAX_SIZE`. Larger samples are dropped,
    /// counted and reported. 1 ≤ `bytes` ≤ `MAX_SIZE`, or 65528 for a type with unbounded fields
    /// (`Message::BOUNDED` says which).
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

    /// With keep-last history: while `depth` samples wait, the *new* one is dropped (and counted).
    /// Usually the oldest makes room.
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

//! Quality of service of an endpoint: what a subscription keeps, what a topic retransmits.

use core::num::NonZeroU16;

/// Whether lost samples are sent again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reliability {
    /// Lost samples stay lost; nothing is acknowledged.
    BestEffort,
    /// Samples are acknowledged and retransmitted.
    Reliable,
}

/// What happens to a sample for which no slot is free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum History {
    /// The oldest waiting sample makes room and is counted as dropped.
    KeepLast,
    /// The new sample waits in the middleware, which is not asked for this reader until its
    /// callback has made room. What the middleware then loses is the middleware's count.
    KeepAll,
}

/// Reliability, history and depth of one publisher or subscription.
///
/// The depth is the number of samples a subscription holds *besides* the one its callback works
/// on. Publishers carry it for the middleware's output queue.
///
/// ```
/// use replenish::qos::{History, Qos, Reliability};
/// let qos = Qos::best_effort().keep_last(1);
/// assert_eq!(qos.reliability, Reliability::BestEffort);
/// assert_eq!((qos.history, qos.depth), (History::KeepLast, 1));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Qos {
    /// Whether lost samples are sent again.
    pub reliability: Reliability,
    /// What happens when all slots are taken.
    pub history: History,
    /// Samples held, 1..=[`Qos::MAX_DEPTH`]; checked where an endpoint is created.
    pub depth: u16,
}

impl Qos {
    /// The most samples one subscription can hold. Every slot is allocated in advance.
    pub const MAX_DEPTH: u16 = 4096;

    /// Reliable, keep last 10: the default profile of ROS 2.
    #[must_use]
    pub const fn reliable() -> Self {
        Self {
            reliability: Reliability::Reliable,
            history: History::KeepLast,
            depth: 10,
        }
    }

    /// Best effort, keep last 10.
    #[must_use]
    pub const fn best_effort() -> Self {
        Self {
            reliability: Reliability::BestEffort,
            history: History::KeepLast,
            depth: 10,
        }
    }

    /// Best effort, keep last 5: the sensor data profile of ROS 2.
    #[must_use]
    pub const fn sensor_data() -> Self {
        Self {
            reliability: Reliability::BestEffort,
            history: History::KeepLast,
            depth: 5,
        }
    }

    /// Keeps the newest `depth` samples and counts the others as dropped.
    #[must_use]
    pub const fn keep_last(self, depth: u16) -> Self {
        Self {
            history: History::KeepLast,
            depth,
            ..self
        }
    }

    /// Holds `depth` samples and leaves further ones in the middleware until there is room.
    #[must_use]
    pub const fn keep_all(self, depth: u16) -> Self {
        Self {
            history: History::KeepAll,
            depth,
            ..self
        }
    }

    /// The depth, if it is in 1..=[`Qos::MAX_DEPTH`].
    #[must_use]
    pub fn checked_depth(&self) -> Option<NonZeroU16> {
        NonZeroU16::new(self.depth).filter(|d| d.get() <= Self::MAX_DEPTH)
    }
}

impl Default for Qos {
    fn default() -> Self {
        Self::reliable()
    }
}

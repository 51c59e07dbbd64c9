//! Quality of service of an endpoint: history, reliability, durability, deadline, lifespan,
//! liveliness, criticality, ingress limits.
//!
//! # Adding a policy
//! 1. An enum or a field here, with its place in [`Qos`] and the presets.
//! 2. [`Qos::check_offers`] says whether an offer satisfies a request, if the policy is matched.
//! 3. Each middleware carries it out: `middleware/in_process/`, and `middleware/xrce/describe.rs`
//!    for the agent, whose own names stand in `replenish-agent`'s `xml.rs`.

use core::num::NonZeroU16;
use core::time::Duration;

/// Whether lost samples are sent again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reliability {
    /// Lost samples stay lost; nothing is acknowledged.
    BestEffort,
    /// Samples are acknowledged and retransmitted.
    Reliable,
}

/// The rule for a sample for which no slot is free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum History {
    /// The oldest waiting sample makes room and is counted as dropped.
    KeepLast,
    /// The new sample waits in the middleware, which is not asked for this reader until its
    /// callback has made room. The middleware counts the samples that it loses then.
    KeepAll,
}

/// Whether a subscription that comes late gets what was published before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Durability {
    /// Late subscriptions get no earlier samples.
    Volatile,
    /// Late subscriptions get the samples that the publisher still keeps.
    TransientLocal,
}

/// Ways for a publisher to show that it is alive, weakest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Liveliness {
    /// A publisher is alive while its program runs.
    Automatic,
    /// A publisher is alive when it publishes, or calls
    /// [`assert_liveliness`](crate::Publisher::assert_liveliness).
    ManualByTopic,
}

/// Whether the samples of topics may wait behind each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Criticality {
    /// The topic's samples may wait behind those of other such topics.
    Normal,
    /// The topic's samples go a way of their own, served first: a backlog of a normal topic does
    /// not delay them. In a middleware with one way only this changes nothing.
    RealTime,
}

/// A limit of the samples that a peer sends for one subscription.
///
/// A flood is stopped at its source and costs this machine nothing. On DDS-XRCE it is the delivery
/// control of `READ_DATA` (7.7.8 of the specification), which the agent carries out.
///
/// ```
/// use core::time::Duration;
/// use replenish::{IngressLimit, Topic};
/// let limit = IngressLimit::none()
///     .bytes_per_second(20_000)
///     .min_interval(Duration::from_millis(10));
/// let camera = Topic::named("camera").ingress_limit(limit);
/// # let _ = camera;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct IngressLimit {
    pub(crate) bytes_per_second: Option<u16>,
    pub(crate) min_interval: Option<Duration>,
    pub(crate) samples: Option<u16>,
    pub(crate) duration: Option<Duration>,
}

impl IngressLimit {
    /// No limit.
    #[must_use]
    pub const fn none() -> Self {
        Self {
            bytes_per_second: None,
            min_interval: None,
            samples: None,
            duration: None,
        }
    }

    /// Allows at most `bytes` bytes of samples each second, 1..=65535.
    #[must_use]
    pub const fn bytes_per_second(self, bytes: u16) -> Self {
        Self {
            bytes_per_second: Some(bytes),
            ..self
        }
    }

    /// Keeps at least `time` between two samples, 1 ms to 65.535 s; fractions of a millisecond are
    /// rounded up.
    #[must_use]
    pub const fn min_interval(self, time: Duration) -> Self {
        Self {
            min_interval: Some(time),
            ..self
        }
    }

    /// The number of samples after which no more come, 1..=65534.
    #[must_use]
    pub const fn samples(self, samples: u16) -> Self {
        Self {
            samples: Some(samples),
            ..self
        }
    }

    /// Delivers samples for `time` and then no more, 1 s to 65535 s in whole seconds.
    #[must_use]
    pub const fn duration(self, time: Duration) -> Self {
        Self {
            duration: Some(time),
            ..self
        }
    }

    /// The first field that is out of range, with its value and what is allowed.
    pub(crate) fn violation(&self) -> Option<(&'static str, u64, &'static str)> {
        let outside = |time: Option<Duration>, from: Duration, to: Duration| {
            time.filter(|time| *time < from || *time > to)
        };
        let micros = |time: Duration| {
            let whole = time.as_secs().saturating_mul(1_000_000);
            whole.saturating_add(time.subsec_micros().into())
        };
        let (from, to) = (Duration::from_millis(1), Duration::from_millis(65_535));
        let interval = outside(self.min_interval, from, to);
        let (from, to) = (Duration::from_secs(1), Duration::from_secs(65_535));
        let duration = outside(self.duration, from, to);
        if self.bytes_per_second == Some(0) {
            return Some(("ingress_limit.bytes_per_second", 0, "1..=65535"));
        }
        if let Some(time) = interval {
            let (field, allowed) = ("ingress_limit.min_interval", "1000..=65535000 us");
            return Some((field, micros(time), allowed));
        }
        if let Some(samples @ (0 | u16::MAX)) = self.samples {
            return Some(("ingress_limit.samples", samples.into(), "1..=65534"));
        }
        let (field, allowed) = ("ingress_limit.duration", "1..=65535 s");
        duration.map(|time| (field, micros(time), allowed))
    }
}

/// Reliability, history and depth of one publisher or subscription, and what else may matter.
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
    /// The rule when all slots are taken.
    pub history: History,
    /// Samples held, 1..=[`Qos::MAX_DEPTH`]; checked where an endpoint is created.
    pub depth: u16,
    /// Whether late subscriptions get what was published before.
    pub durability: Durability,
    /// The longest time between two samples that is promised (publisher) or asked for
    /// (subscription), 1 ms or more; none or zero: any. A longer one is an event
    /// ([`on_event`](crate::AddHandles::on_event)). In milliseconds on XRCE.
    pub deadline: Option<Duration>,
    /// Age at which a sample is no longer worth delivering: an older one is dropped. None or zero:
    /// for ever. Of publishers. In milliseconds on XRCE.
    pub lifespan: Option<Duration>,
    /// The way in which a publisher shows that it is alive, or has to show it to a subscription.
    /// Not on XRCE.
    pub liveliness: Liveliness,
    /// Time that a publisher counts as alive after it has shown it, 1 ms or more; none or zero: for
    /// ever. An end is an event. Not on XRCE.
    pub lease: Option<Duration>,
    /// Whether samples may wait behind those of other topics.
    pub criticality: Criticality,
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
            durability: Durability::Volatile,
            deadline: None,
            lifespan: None,
            liveliness: Liveliness::Automatic,
            lease: None,
            criticality: Criticality::Normal,
        }
    }

    /// Best effort, keep last 10.
    #[must_use]
    pub const fn best_effort() -> Self {
        Self {
            reliability: Reliability::BestEffort,
            ..Self::reliable()
        }
    }

    /// Best effort, keep last 5: the sensor data profile of ROS 2.
    #[must_use]
    pub const fn sensor_data() -> Self {
        Self {
            depth: 5,
            ..Self::best_effort()
        }
    }

    /// Reliable, keep last 10: the profile of services in ROS 2.
    #[must_use]
    pub const fn services() -> Self {
        Self::reliable()
    }

    /// Reliable, keep last 1000: the profile of the services of parameters in ROS 2.
    #[must_use]
    pub const fn parameters() -> Self {
        Self::services().keep_last(1000)
    }

    /// The profile of an endpoint that says nothing, as [`Qos::default`]: reliable, keep last 10.
    /// (ROS 2's `best_available` needs to know the peers: `Node::best_available_subscription`.)
    /// (In ROS 2 each middleware has its own.)
    #[must_use]
    pub const fn system_default() -> Self {
        Self::reliable()
    }

    /// Reliable, keep last 1000: the profile of `/parameter_events` in ROS 2.
    #[must_use]
    pub const fn parameter_events() -> Self {
        Self::reliable().keep_last(1000)
    }

    /// Reliable, keep last 1, late subscriptions get it: for what changes rarely (maps, robot
    /// descriptions, the status of actions).
    #[must_use]
    pub const fn latched() -> Self {
        Self::reliable().keep_last(1).transient_local()
    }

    /// Best effort, keep last 1: the profile of `/clock` in ROS 2.
    #[must_use]
    pub const fn clock() -> Self {
        Self::best_effort().keep_last(1)
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

    /// Late subscriptions get what the publisher still keeps.
    #[must_use]
    pub const fn transient_local(self) -> Self {
        Self {
            durability: Durability::TransientLocal,
            ..self
        }
    }

    /// Sets the longest time between two samples.
    #[must_use]
    pub const fn deadline(self, time: Duration) -> Self {
        Self {
            deadline: Some(time),
            ..self
        }
    }

    /// Samples are worth delivering for this time.
    #[must_use]
    pub const fn lifespan(self, time: Duration) -> Self {
        Self {
            lifespan: Some(time),
            ..self
        }
    }

    /// A publisher shows that it is alive in this way.
    #[must_use]
    pub const fn liveliness(self, liveliness: Liveliness) -> Self {
        Self { liveliness, ..self }
    }

    /// A publisher counts as alive for this time after it has shown it.
    #[must_use]
    pub const fn lease(self, time: Duration) -> Self {
        Self {
            lease: Some(time),
            ..self
        }
    }

    /// Samples of this topic never wait behind those of normal ones.
    #[must_use]
    pub const fn real_time(self) -> Self {
        Self {
            criticality: Criticality::RealTime,
            ..self
        }
    }

    /// The first time that is too short, with its name.
    pub(crate) fn too_short(&self) -> Option<(&'static str, Duration)> {
        let times = [("qos.deadline", self.deadline), ("qos.lease", self.lease)];
        let short = |time: &Duration| *time > Duration::ZERO && *time < Duration::from_millis(1);
        let mut short = times
            .into_iter()
            .filter_map(|(name, time)| Some((name, time.filter(short)?)));
        short.next()
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

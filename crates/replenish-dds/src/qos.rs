//! Quality of service: ROS 2's profiles as DDS policies.
//!
//! | ROS 2 | DDS |
//! |---|---|
//! | reliability | RELIABILITY; a write waits for nobody: what finds the window full waits in our queue |
//! | durability | DURABILITY: volatile or transient local |
//! | history, depth | HISTORY of writers; readers keep at least 512, whatever their depth |
//! | deadline | DEADLINE: offered by writers, asked for by readers |
//! | lifespan | LIFESPAN of writers |
//! | liveliness | automatic, without end: the default, as in ROS 2 |

use replenish_os::Nanos;
use rustdds::policy::{Deadline, Durability as DdsDurability, Lifespan, ResourceLimits};
use rustdds::{Duration, QosPolicies, QosPolicyBuilder, policy};

/// Samples of a topic that RustDDS keeps for its readers, taken or not; the oldest is then
/// overwritten, taken or not. The depth of a reader in ROS 2 is that of its own queue, which comes
/// after.
const READER_SAMPLES: i32 = 512;

/// Samples of a reliable writer that may be unacknowledged.
pub(crate) const WINDOW: u64 = 256;

/// Whether samples reach readers that come later.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Durability {
    /// No.
    #[default]
    Volatile,
    /// As many as the depth says, while the writer lives.
    TransientLocal,
}

/// How many samples are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum History {
    /// The last ones, 1 to 65536.
    KeepLast(usize),
    /// All that the limits allow.
    KeepAll,
}

/// The quality of service of a writer or reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Lost samples are sent again.
    pub reliable: bool,
    /// The samples for late readers.
    pub durability: Durability,
    /// The samples that are kept.
    pub history: History,
    /// The longest time between two samples.
    pub deadline: Option<Nanos>,
    /// How long a writer's sample is of use.
    pub lifespan: Option<Nanos>,
}

/// The policies of which a writer offers less than a reader requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mismatch {
    /// Best effort is offered, reliable is asked for.
    pub reliability: bool,
    /// Volatile is offered, transient local is asked for.
    pub durability: bool,
    /// A longer deadline, or none, is offered than asked for.
    pub deadline: bool,
}

impl Mismatch {
    /// The incompatible policies. A policy left out in discovery has its default (DDS 1.4, 2.2.3).
    pub(crate) fn between(offered: &QosPolicies, asked: &QosPolicies) -> Self {
        let best_effort = Some(policy::Reliability::BestEffort);
        let durability = |qos: &QosPolicies| qos.durability().unwrap_or(DdsDurability::Volatile);
        let deadline = |qos: &QosPolicies| qos.deadline().map_or(Duration::INFINITE, |d| d.0);
        Self {
            reliability: offered.reliability() == best_effort
                && asked
                    .reliability()
                    .is_some_and(|asked| Some(asked) != best_effort),
            durability: durability(offered) < durability(asked),
            deadline: deadline(offered) > deadline(asked),
        }
    }

    /// Both together.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            reliability: self.reliability || other.reliability,
            durability: self.durability || other.durability,
            deadline: self.deadline || other.deadline,
        }
    }
}

impl Default for Qos {
    /// ROS 2's default: reliable, volatile, the last ten.
    fn default() -> Self {
        Self {
            reliable: true,
            durability: Durability::Volatile,
            history: History::KeepLast(10),
            deadline: None,
            lifespan: None,
        }
    }
}

impl Qos {
    /// Whether late readers get samples.
    pub(crate) fn is_volatile(&self) -> bool {
        self.durability == Durability::Volatile
    }

    pub(crate) fn writer(&self) -> QosPolicies {
        let history = match self.history {
            History::KeepLast(depth) => policy::History::KeepLast {
                depth: clamp(depth),
            },
            History::KeepAll => policy::History::KeepAll,
        };
        let policies = self
            .common()
            .history(history)
            .resource_limits(samples(WINDOW as i32));
        match self.lifespan {
            Some(nanos) => policies.lifespan(Lifespan {
                duration: duration(nanos),
            }),
            None => policies,
        }
        .build()
    }

    pub(crate) fn reader(&self) -> QosPolicies {
        let depth = match self.history {
            History::KeepLast(depth) => clamp(depth).max(READER_SAMPLES),
            History::KeepAll => READER_SAMPLES,
        };
        self.common()
            .history(policy::History::KeepLast { depth })
            .resource_limits(samples(depth))
            .build()
    }

    fn common(&self) -> QosPolicyBuilder {
        let durability = match self.durability {
            Durability::Volatile => DdsDurability::Volatile,
            Durability::TransientLocal => DdsDurability::TransientLocal,
        };
        let policies = QosPolicyBuilder::new().durability(durability);
        let policies = if self.reliable {
            policies.reliable(Duration::ZERO)
        } else {
            policies.best_effort()
        };
        match self.deadline {
            Some(nanos) => policies.deadline(Deadline(duration(nanos))),
            None => policies,
        }
    }
}

fn samples(max_samples: i32) -> ResourceLimits {
    ResourceLimits {
        max_samples,
        max_instances: 1,
        max_samples_per_instance: max_samples,
    }
}

fn clamp(depth: usize) -> i32 {
    i32::try_from(depth.clamp(1, 65_536)).unwrap_or(1)
}

fn duration(nanos: Nanos) -> Duration {
    Duration::from_nanos(i64::try_from(nanos).unwrap_or(i64::MAX))
}

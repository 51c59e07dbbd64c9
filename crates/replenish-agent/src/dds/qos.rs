//! Quality of service: ROS 2's profiles as DDS policies, and the memory that they take.
//!
//! | ROS 2 | DDS |
//! |---|---|
//! | reliability | RELIABILITY; a write waits for nobody: what finds the window full waits in our queue |
//! | durability | DURABILITY: volatile or transient local |
//! | history, depth | HISTORY of transient local writers; others keep what is not acknowledged yet |
//! | deadline | DEADLINE: offered by writers, asked for by readers |
//! | lifespan | LIFESPAN of writers |
//! | liveliness | automatic, without end: the default, as in ROS 2 |

use replenish_os::Nanos;
use replenish_rtps::wire::{self, INFINITE, Reliability};

/// Samples of a reliable writer that may be unacknowledged, and of a best-effort one unsent.
pub(super) const WINDOW: usize = 256;

/// Bytes of all samples of a writer together. It takes memory for what it keeps.
const WRITER_BYTES: usize = 256 << 10;

/// Samples of a reader that wait for an earlier one or for their other parts; whole ones are taken
/// at once. All of their memory is reserved with the reader.
const READER_SAMPLES: usize = 8;

/// Bytes before a payload, of the encapsulation and of Cyclone's header of requests, and after it:
/// others pad the end.
const AROUND: usize = 4 + super::header::LEN + 3;

/// Bytes for the peers of an endpoint and for the requests that wait.
const PEERS: usize = 128 << 10;

/// The most memory of an endpoint whose samples have up to `sample` bytes: a service has two ends.
pub(crate) const fn endpoint_bytes(sample: usize) -> usize {
    let writer = if sample > WRITER_BYTES {
        sample
    } else {
        WRITER_BYTES
    };
    writer + AROUND + READER_SAMPLES * (sample + AROUND) + PEERS
}

/// The memory of a writer or reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct EndpointMemory {
    /// Bytes of the longest sample.
    pub(super) sample: usize,
    /// Samples.
    pub(super) samples: usize,
    /// Bytes of all of a writer's.
    pub(super) together: usize,
}

/// Whether samples reach readers that come later.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Durability {
    /// No.
    #[default]
    Volatile,
    /// As many as the depth says, while the writer lives.
    TransientLocal,
}

/// The samples that are kept.
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
    /// The time for which a writer's sample is of use.
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
    /// The incompatible policies (DDS 1.4, 2.2.3).
    pub(super) fn between(offered: &wire::Qos, asked: &wire::Qos) -> Self {
        Self {
            reliability: offered.reliability < asked.reliability,
            durability: offered.durability < asked.durability,
            deadline: offered.deadline > asked.deadline,
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
    /// A writer as it is announced, and its memory.
    ///
    /// A volatile writer keeps all until it is acknowledged, so that a client's burst arrives: its
    /// depth is that of nobody's queue.
    pub(super) fn writer(&self, sample: usize) -> (wire::Qos, EndpointMemory) {
        let kept = match (self.durability, self.history) {
            (Durability::TransientLocal, History::KeepLast(depth)) => depth.clamp(1, WINDOW),
            _ => 0,
        };
        let sample = sample + AROUND;
        let memory = EndpointMemory {
            sample,
            samples: if kept == 0 { WINDOW } else { kept },
            together: WRITER_BYTES.max(sample),
        };
        let depth = u32::try_from(kept).unwrap_or(u32::MAX);
        let lifespan = self.lifespan.unwrap_or(INFINITE);
        let qos = wire::Qos {
            lifespan,
            ..self.common(depth)
        };
        (qos, memory)
    }

    /// A reader as it is announced, and its memory.
    pub(super) fn reader(&self, sample: usize) -> (wire::Qos, EndpointMemory) {
        let sample = sample + AROUND;
        let memory = EndpointMemory {
            sample,
            samples: READER_SAMPLES,
            together: READER_SAMPLES * sample,
        };
        // The depth of a client's reader is that of its own queue, which comes after.
        (self.common(0), memory)
    }

    fn common(&self, depth: u32) -> wire::Qos {
        wire::Qos {
            reliability: if self.reliable {
                Reliability::Reliable
            } else {
                Reliability::BestEffort
            },
            durability: match self.durability {
                Durability::Volatile => wire::Durability::Volatile,
                Durability::TransientLocal => wire::Durability::TransientLocal,
            },
            deadline: self.deadline.unwrap_or(INFINITE),
            depth,
            ..wire::Qos::ros()
        }
    }
}

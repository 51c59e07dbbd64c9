//! What an agent listens on and how much it may hold.

use std::net::{Ipv4Addr, SocketAddr};

/// Time and intervals in nanoseconds.
pub type Nanos = u64;

const SECOND: Nanos = 1_000_000_000;

/// How to run an [`Agent`](crate::Agent).
#[derive(Clone, Debug)]
pub struct AgentConfig {
    /// Where to listen. Port 0 lets the operating system choose one.
    ///
    /// Loopback unless told otherwise: XRCE knows no authentication, so that whoever reaches
    /// this address can read and write every topic.
    pub addr: SocketAddr,
    /// Bounds on what clients can make the agent hold.
    pub limits: Limits,
}

impl Default for AgentConfig {
    /// `127.0.0.1:8888`, the port that stock agents use.
    fn default() -> Self {
        Self {
            addr: (Ipv4Addr::LOCALHOST, 8888).into(),
            limits: Limits::default(),
        }
    }
}

/// Bounds on what clients can make the agent hold. What is above is refused, or dropped and
/// counted in [`Stats`](crate::Stats); it never ends the agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at the same time.
    pub clients: usize,
    /// Entities of one client, of all kinds together.
    pub entities: usize,
    /// Streams of one client in each direction.
    pub streams: usize,
    /// Bytes of one message to a client, even if the client takes longer ones, and of one from a
    /// client that is kept until an earlier one arrives; at least 64.
    pub message: usize,
    /// Bytes of one sample, fragmented or not; at most 65531, the protocol's limit.
    pub sample: usize,
    /// Bytes of all samples that wait in the queues of all readers.
    pub queued_bytes: usize,
    /// Samples in the queue of a reader whose QoS names no depth.
    pub default_depth: usize,
    /// Samples in the queue of a reader, whatever its QoS says.
    pub max_depth: usize,
    /// How long a client may be silent before it is forgotten. Before that, at a third of it, it
    /// is asked for a sign of life.
    pub silence: Nanos,
}

/// What a submessage's 16-bit length allows besides the 4 bytes of request and object.
const MAX_SAMPLE: usize = 65_531;

impl Limits {
    /// Bytes of the submessage that carries the largest sample, header and padding included.
    pub(crate) fn longest_submessage(&self) -> usize {
        (4 + 4 + self.sample.min(MAX_SAMPLE)).next_multiple_of(4)
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            clients: 64,
            entities: 128,
            streams: 4,
            message: 8 * 1024,
            sample: MAX_SAMPLE,
            queued_bytes: 64 * 1024 * 1024,
            default_depth: 16,
            max_depth: 256,
            silence: 30 * SECOND,
        }
    }
}

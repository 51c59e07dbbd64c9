//! Settings and storage of a session.

use crate::Nanos;
use crate::stream::Reliability;
use crate::wire::{ClientKey, SessionId};

/// Settings of a session. All times are in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Identifies this client to the agent; no two clients of an agent may have the same.
    pub key: ClientKey,
    /// The first session id; later sessions count up from it. From 0x81 on the key is not part of
    /// every message, which is what the agent expects on UDP and serial lines.
    pub session: SessionId,
    /// The longest message in bytes, both ways: 64..=65507 on UDP. micro-ROS has 512.
    pub mtu: u16,
    /// Time until a log-in that was not answered is sent again; doubles up to `retry_max`.
    pub retry_first: Nanos,
    /// The longest time between log-ins. Must exceed the round trip to the agent.
    pub retry_max: Nanos,
    /// How the loss of the agent is noticed; `None`: never.
    pub ping: Option<PingPolicy>,
    /// Heartbeats and window of the reliable output stream.
    pub reliability: Reliability,
}

/// How the loss of the agent is noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PingPolicy {
    /// Ping after that long without a message from the agent, and again after each such time.
    pub after: Nanos,
    /// The agent counts as lost after that long without a message, the last `silence_limit - after`
    /// of it with pings.
    pub silence_limit: Nanos,
}

impl Config {
    /// The defaults, for client `key`: session 0x81, MTU 512, log-in every 0.2 s to 1 s, ping after
    /// 0.2 s of silence, loss after 0.9 s.
    #[must_use]
    pub fn new(key: ClientKey) -> Self {
        Config {
            key,
            session: SessionId(0x81),
            mtu: 512,
            retry_first: 200_000_000,
            retry_max: 1_000_000_000,
            ping: Some(PingPolicy {
                after: 200_000_000,
                silence_limit: 900_000_000,
            }),
            reliability: Reliability::default(),
        }
    }
}

/// Storage of a session; lengths are free, the comments say what follows from them.
#[derive(Debug)]
pub struct Buffers<S> {
    /// One message: length at least `mtu`.
    pub best_effort_out: S,
    /// The messages sent and not acknowledged: `length / mtu` of them, at most the session's `N`.
    /// The largest reliable sample fills all of them.
    pub reliable_out: S,
    /// The messages that wait for a missing one: `length / mtu` of them, at most `N`.
    pub reliable_in: S,
    /// The largest sample that can be received in fragments, plus 8 bytes.
    pub fragments_in: S,
    /// What was created, to create it anew: about 20 bytes and the names for each object.
    pub journal: S,
}

//! Settings of the XRCE adapter, and what can go wrong when it connects.

use super::limits::{JOURNAL, LARGEST, OVERHEAD, WINDOW};
use crate::Nanos;
use crate::error::Error;
use crate::platform::{STD, StaticText, Text, io, label, text};
use core::fmt;
use replenish_xrce::client::PingPolicy;
use replenish_xrce::features::FRAGMENTS;
use replenish_xrce::stream::{AckPolicy, MOST_FRAGMENTS, Reliability};
use replenish_xrce::wire::Status;

/// Settings of an [`Xrce`](super::Xrce). [`Default`] is what micro-ROS does, where that is
/// sensible. Times are in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct XrceConfig {
    /// The longest datagram in bytes, both ways, 64..=65507. Best-effort samples must fit one, with
    /// 12 bytes to spare; reliable ones are cut into pieces. micro-ROS has 512.
    pub mtu: u16,
    /// Reliable datagrams that are kept until they are acknowledged, 1..=64; without `std` up to 4.
    pub window: u16,
    /// The largest sample that can be sent and received on a reliable topic, in bytes, up to
    /// 16777216, and up to 32000 * (`mtu` - 12). Six times as much memory is taken at the start. A
    /// longer one that fits into the window, up to 65528, can be sent, too. One of more than 65528
    /// bytes needs an agent that takes such: `replenish agent --sample`. Without the feature `full`
    /// (which `std` brings) it is `mtu` - 12 at most.
    pub max_sample: usize,
    /// Bytes for the descriptions of what was created, from which it is created anew at the next
    /// log-in, 64 or more: about 140 for a publisher and 175 for a subscription with short names.
    pub journal: usize,
    /// The DDS domain.
    pub domain: i16,
    /// Identifies this client; no two clients of an agent may have the same, and none may have all
    /// zeros. `None`: at random, with feature `std` only: a microcontroller has no random bits to
    /// make one from.
    pub key: Option<[u8; 4]>,
    /// How long to wait for the agent's first answer.
    pub connect_timeout: Nanos,
    /// How long to wait until the agent has created a reader or writer.
    pub request_timeout: Nanos,
    /// How the loss of the agent is noticed.
    pub ping: PingPolicy,
    /// Heartbeats and window of reliable topics.
    pub reliability: Reliability,
    /// When what is received on reliable topics is acknowledged.
    pub acks: AckPolicy,
}

/// The part of the configuration that outlives connecting.
pub(super) struct Settings {
    pub(super) mtu: u16,
    pub(super) domain: i16,
    pub(super) max_sample: usize,
    pub(super) request_timeout: Nanos,
}

impl Default for XrceConfig {
    /// MTU 512, 64 datagrams kept, samples up to 16 KiB, domain 0, random key, 1.5 s for the
    /// agent's first answer, 1 s for a reader or writer, ping after 0.14 s of silence, loss after
    /// 0.7 s.
    fn default() -> Self {
        Self {
            mtu: 512,
            window: 64,
            max_sample: 16 * 1024,
            journal: JOURNAL,
            domain: 0,
            key: None,
            connect_timeout: 1_500_000_000,
            request_timeout: 1_000_000_000,
            ping: PingPolicy {
                after: 140_000_000,
                silence_limit: 700_000_000,
            },
            reliability: Reliability::default(),
            acks: AckPolicy::IMMEDIATE,
        }
    }
}

impl XrceConfig {
    /// For slow lines: acknowledgements in batches, and more patience with an agent that may only
    /// be behind a long message: 3 s for its first answer and for a reader or writer.
    #[must_use]
    pub fn slow_line() -> Self {
        let ping = PingPolicy {
            after: 300_000_000,
            silence_limit: 850_000_000,
        };
        let reliability = Reliability {
            heartbeat_first: 200_000_000,
            heartbeat_min: 20_000_000,
            heartbeat_max: 400_000_000,
            ..Reliability::default()
        };
        Self {
            ping,
            reliability,
            acks: AckPolicy::BATCHED,
            connect_timeout: 3_000_000_000,
            request_timeout: 3_000_000_000,
            ..Self::default()
        }
    }

    /// For microcontrollers: a line as slow, and small buffers. MTU 256, a window of 4, samples of
    /// up to 240 bytes, which one message holds: there are no buffers for fragments.
    #[must_use]
    pub fn small() -> Self {
        Self {
            mtu: 256,
            window: 4,
            max_sample: 240,
            ..Self::slow_line()
        }
    }

    pub(super) fn check(&self) -> Result<(), ConnectError> {
        let setting = |field, allowed| {
            let allowed = label(allowed);
            Err(ConnectError::Setting { field, allowed })
        };
        if !(64..=65_507).contains(&self.mtu) {
            return setting("mtu", "from 64 to 65507 bytes");
        }
        if !(1..=WINDOW).contains(&usize::from(self.window)) {
            return setting(
                "window",
                if STD {
                    "from 1 to 64 datagrams"
                } else {
                    "from 1 to 4 datagrams"
                },
            );
        }
        if !(1..=LARGEST).contains(&self.max_sample) {
            return setting("max_sample", "from 1 to 16777216 bytes");
        }
        let in_a_message = usize::from(self.mtu).saturating_sub(OVERHEAD);
        if FRAGMENTS && self.max_sample > in_a_message.saturating_mul(MOST_FRAGMENTS) {
            return setting("max_sample", "at most 32000 * (mtu - 12) bytes");
        }
        if !FRAGMENTS && self.max_sample > in_a_message {
            return setting("max_sample", "at most mtu - 12 without feature `full`");
        }
        if self.journal < 64 {
            return setting("journal", "64 bytes or more");
        }
        if self.key.is_none() && !STD {
            return setting("key", "set, without feature `std`");
        }
        if self.key == Some([0; 4]) {
            return setting("key", "other than 0, which the protocol reserves");
        }
        if self.acks.every == 0 {
            return setting("acks.every", "at least 1");
        }
        Ok(())
    }

    /// The key to use: never all zeros, which the protocol forbids.
    pub(super) fn client_key(&self) -> [u8; 4] {
        if !STD {
            return self.key.unwrap_or_default(); // it was checked
        }
        let random = || {
            let hash = crate::platform::random(0);
            u32::try_from(hash >> 32).unwrap_or(1).max(1).to_be_bytes()
        };
        self.key.unwrap_or_else(random)
    }
}

/// Connecting to an agent failed.
#[derive(Debug)]
#[non_exhaustive]
pub enum ConnectError {
    /// The address cannot be resolved or used.
    Address {
        /// As it was given.
        agent: Text,
        /// The system's error.
        source: io::Error,
    },
    /// A setting is outside its range.
    Setting {
        /// Its name.
        field: &'static str,
        /// The allowed range.
        allowed: StaticText,
    },
    /// No agent answered in time.
    NoAgent {
        /// Its address.
        agent: Text,
        /// The time that it had, in nanoseconds.
        waited: Nanos,
    },
    /// The agent refused the session.
    Refused {
        /// Its address.
        agent: Text,
        /// Its reason.
        status: Status,
    },
    /// The operating system refused something else.
    Io {
        /// The action that failed.
        what: StaticText,
        /// Its error.
        source: io::Error,
    },
}

impl fmt::Display for ConnectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Address { agent, source } => {
                write!(f, "the agent's address {agent} cannot be used: {source}")
            }
            Self::Setting { field, allowed } => {
                write!(f, "the XRCE setting {field} must be {allowed}")
            }
            Self::NoAgent { agent, waited } => {
                let (seconds, tenths) = (waited / 1_000_000_000, waited / 100_000_000 % 10);
                write!(
                    f,
                    "no XRCE agent answered at {agent} within {seconds}.{tenths} s"
                )
            }
            Self::Refused { agent, status } => {
                write!(f, "the XRCE agent at {agent} refused a session: {status}")
            }
            Self::Io { what, source } => write!(f, "{what}: {source}"),
        }
    }
}

impl core::error::Error for ConnectError {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Address { source, .. } | Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}

impl From<ConnectError> for Error {
    fn from(e: ConnectError) -> Self {
        Self::Connect {
            reason: text!("{e}"),
        }
    }
}

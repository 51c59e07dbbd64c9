//! Bounds on the resources that clients can take, and their ranges.

use replenish_os::config::{ConfigError, within};
use replenish_xrce::Nanos;

const SECOND: Nanos = 1_000_000_000;

/// The longest sample that can be asked for.
const MAX_SAMPLE: usize = 16 << 20;

/// The longest sample whose length a submessage can say. A longer one goes in fragments alone.
const SHORT_SAMPLE: usize = 65_531;

/// Bounds on the resources that clients can take. The agent refuses more, or drops and
/// counts it in [`Stats`](crate::Stats); it never ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at the same time, 1 to 4096.
    pub clients: usize,
    /// Entities of one client, of all kinds together, 1 to 4096.
    pub entities: usize,
    /// Streams of one client in each direction, 1 to 16.
    pub streams: usize,
    /// Bytes of one message to a client, even if the client takes longer ones, and of one from a
    /// client that is kept until an earlier one arrives, 64 to 65535.
    pub message: usize,
    /// Bytes of one sample, fragmented or not, 1 to 16777216. Each reliable stream of a client
    /// takes as much of [`client_bytes`](Self::client_bytes), which is to be four times as much
    /// above 65531: a stream each way, a sample that waits, and all else.
    pub sample: usize,
    /// Bytes that one client makes the agent keep: buffers of its streams, descriptions of its
    /// entities, samples in the queues of its readers and in the history of its writers (a sample
    /// that several of them keep counts for each), 4096 to 2^40. They are its own: no other client
    /// can take them, and all clients together keep at most [`memory`](Self::memory).
    pub client_bytes: usize,
    /// Samples in the queue of a reader whose QoS names no depth, 1 to `max_depth`.
    pub default_depth: usize,
    /// Samples in the queue of a reader or in the history of a writer, whatever its QoS says, 1 to
    /// 65535.
    pub max_depth: usize,
    /// Requests of one requester that wait for their reply; above that the oldest is forgotten. 1
    /// to 65535.
    pub calls: usize,
    /// Datagrams per second taken from one client, with bursts of up to a second's worth; 0 for no
    /// limit, at most 10 000 000.
    pub datagrams_per_second: u32,
    /// Log-ins and pings per second taken from all who have no session, together; a quarter of it
    /// from one host, a sixteenth from one address. 0 for no limit, at most 10 000 000.
    pub unauthenticated_per_second: u32,
    /// Bytes that leave for an address for each byte from there, before it has shown that it
    /// receives: it acknowledges something. Samples wait for that. Connections and serial lines
    /// have shown it. 0 for no limit, at most 1000.
    pub reflection: u32,
    /// Time in ns that a full reliable keep-all reader may hold up reliable keep-all writers before
    /// its samples are dropped; 0 to 60 s. `None`: as long as both live.
    pub writer_block_limit: Option<Nanos>,
    /// The longest delay in ns of the acknowledgement of a reliable message until its samples have
    /// reached all their reliable readers; 0 to 60 s. Readers that lag behind by more are not
    /// waited for. With 0 nothing is waited for: then what the agent has queued is lost with it.
    /// Should be below the time that clients wait for an acknowledgement, which is 1 s with
    /// micro-ROS.
    pub confirm_timeout: Nanos,
    /// Time in ns after its own start in which the agent keeps samples of returning clients for
    /// readers whose clients return later; 0 to 60 s. Until then these samples are not confirmed.
    pub recovery_window: Nanos,
    /// Time in ns that a client may be silent before the agent forgets it, 10 ms to 24 h. After a
    /// third of it the agent asks the client for a sign of life.
    pub silence: Nanos,
}

impl Limits {
    /// The limits of [`Limits::default`].
    pub const DEFAULT: Limits = Limits {
        clients: 64,
        entities: 128,
        streams: 6,
        message: 8 * 1024,
        sample: SHORT_SAMPLE,
        client_bytes: 8 * 1024 * 1024,
        default_depth: 16,
        max_depth: 256,
        calls: 64,
        datagrams_per_second: 50_000,
        unauthenticated_per_second: 1_000,
        reflection: 3,
        writer_block_limit: None,
        confirm_timeout: SECOND / 2,
        recovery_window: SECOND * 5 / 2,
        silence: 30 * SECOND,
    };

    /// Bytes that all clients together can make the agent keep.
    #[must_use]
    pub const fn memory(&self) -> usize {
        self.clients.saturating_mul(self.client_bytes)
    }

    /// Whether samples may be longer than a submessage can say.
    pub(crate) const fn takes_long_samples(&self) -> bool {
        self.sample > SHORT_SAMPLE
    }

    /// Bytes of the submessage that carries the largest sample, header and padding included. A
    /// request or reply goes with 24 bytes that say which one it is.
    pub(crate) fn longest_submessage(&self) -> usize {
        (4 + 4 + 24 + self.sample).next_multiple_of(4)
    }

    /// Checks all ranges.
    ///
    /// # Errors
    /// The first limit that is out of its range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        within("limits.clients", self.clients, 1..=4096)?;
        within("limits.entities", self.entities, 1..=4096)?;
        within("limits.streams", self.streams, 1..=16)?;
        within("limits.message", self.message, 64..=65_535)?;
        within("limits.sample", self.sample, 1..=MAX_SAMPLE)?;
        let least = if self.takes_long_samples() {
            self.sample.saturating_mul(4)
        } else {
            4096
        };
        within("limits.client_bytes", self.client_bytes, least..=1 << 40)?;
        within("limits.max_depth", self.max_depth, 1..=65_535)?;
        let depth = 1..=self.max_depth;
        within("limits.default_depth", self.default_depth, depth)?;
        within("limits.calls", self.calls, 1..=65_535)?;
        let rate = 0..=10_000_000;
        within(
            "limits.datagrams_per_second",
            self.datagrams_per_second,
            rate.clone(),
        )?;
        within(
            "limits.unauthenticated_per_second",
            self.unauthenticated_per_second,
            rate,
        )?;
        within("limits.reflection", self.reflection, 0..=1000)?;
        within(
            "limits.writer_block_limit",
            self.writer_block_limit.unwrap_or(0),
            0..=60 * SECOND,
        )?;
        within(
            "limits.confirm_timeout",
            self.confirm_timeout,
            0..=60 * SECOND,
        )?;
        within(
            "limits.recovery_window",
            self.recovery_window,
            0..=60 * SECOND,
        )?;
        let silence = SECOND / 100..=24 * 3600 * SECOND;
        within("limits.silence", self.silence, silence)
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_every_error_names_field_value_and_range() {
        assert_eq!(Limits::DEFAULT.validate(), Ok(()));
        let with = |change: fn(&mut Limits)| {
            let mut limits = Limits::DEFAULT;
            change(&mut limits);
            limits
        };
        let wrong = [
            with(|limits| limits.clients = 0),
            with(|limits| limits.message = 63),
            with(|limits| limits.sample = 16_777_217),
            with(|limits| limits.sample = 4_000_000),
            with(|limits| (limits.default_depth, limits.max_depth) = (20, 10)),
            with(|limits| limits.silence = 1),
            with(|limits| limits.datagrams_per_second = 10_000_001),
        ];
        let texts = [
            "limits.clients is 0, allowed is 1 to 4096",
            "limits.message is 63, allowed is 64 to 65535",
            "limits.sample is 16777217, allowed is 1 to 16777216",
            "limits.client_bytes is 8388608, allowed is 16000000 to 1099511627776",
            "limits.default_depth is 20, allowed is 1 to 10",
            "limits.silence is 1, allowed is 10000000 to 86400000000000",
            "limits.datagrams_per_second is 10000001, allowed is 0 to 10000000",
        ];
        for (limits, text) in wrong.iter().zip(texts) {
            assert_eq!(limits.validate().unwrap_err().to_string(), text);
        }
    }
}

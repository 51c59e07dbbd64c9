//! A talker of ROS 2 without an agent: discovery and one best-effort writer of `std_msgs/msg/Int32`
//! on `/chatter`. Datagrams and times go in and out; the link is the caller's.
//!
//! The image `talker` runs it on the board, `tools/executor-size` links it alone, and
//! `crates/replenish-rtps/tests/peers.rs` puts it on a socket, where genuine ROS 2 hears it.

use core::net::SocketAddr;
use replenish_rtps::participant::{
    ConfigError, EndpointSpec, Limits, Participant, ParticipantConfig, WriterId,
};
use replenish_rtps::wire::{CDR_LE, GuidPrefix, Nanos, Qos, Reliability, TypeHash};

/// Bytes of a datagram that it sends; those that it takes in may be longer.
pub const DATAGRAM: usize = 1200;
/// Between two numbers.
const PERIOD: Nanos = 100_000_000;

/// The hash of `std_msgs/msg/Int32` (REP-2016), which ROS 2's graph shows.
const HASH: TypeHash = TypeHash([
    0xb6, 0x57, 0x8d, 0xed, 0x3c, 0x58, 0xc6, 0x26, 0xcf, 0xe8, 0xd1, 0xa6, 0xfb, 0x6e, 0x04, 0xf7,
    0x06, 0xf9, 0x7e, 0x9f, 0x03, 0xd2, 0x72, 0x7c, 0x9f, 0xf4, 0xe7, 0x4b, 0x1c, 0xef, 0x0d, 0xeb,
]);

/// The room of a small board.
const LIMITS: Limits = Limits {
    participants: 2,
    endpoints: 4,
    own_endpoints: 1,
    matches: 2,
    events: 16,
};

/// The talker.
#[derive(Debug)]
pub struct Talker {
    participant: Participant,
    writer: WriterId,
    number: i32,
    next: Nanos,
}

impl Talker {
    /// A talker that is reached at `own` and announces itself at `group`: a multicast group, or the
    /// port of a peer. All its memory is taken here.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn new(
        domain: u32,
        prefix: GuidPrefix,
        own: SocketAddr,
        group: &[SocketAddr],
        now: Nanos,
    ) -> Result<Self, ConfigError> {
        let config = ParticipantConfig {
            domain,
            discovery: [own].into_iter().collect(),
            user: [own].into_iter().collect(),
            announce_to: group,
            datagram: DATAGRAM,
            host_datagram: DATAGRAM,
            announcements: 2,
            announcement_bytes: 1024,
            whole_graph: false,
            limits: LIMITS,
            ..ParticipantConfig::new(prefix)
        };
        let mut participant = Participant::new(&config, now)?;
        let qos = Qos {
            reliability: Reliability::BestEffort,
            depth: 1,
            ..Qos::ros()
        };
        let spec = EndpointSpec {
            type_hash: Some(HASH),
            qos,
            sample_bytes: 8,
            ..EndpointSpec::new("rt/chatter", "std_msgs::msg::dds_::Int32_")
        };
        let writer = participant.create_writer(&spec, now)?;
        Ok(Self {
            participant,
            writer,
            number: 0,
            next: now,
        })
    }

    /// Takes a datagram in.
    pub fn receive(&mut self, datagram: &[u8], now: Nanos) {
        // Anybody may send a damaged one.
        self.participant.receive(datagram, now).ok();
        while self.participant.event().is_some() {}
    }

    /// The next datagram that is due and where it goes.
    pub fn poll(&mut self, buf: &mut [u8; DATAGRAM], now: Nanos) -> Option<(usize, SocketAddr)> {
        if now >= self.next {
            self.next = now.saturating_add(PERIOD);
            self.number = self.number.wrapping_add(1);
            let [a, b, c, d] = CDR_LE;
            let [e, f, g, h] = self.number.to_le_bytes();
            let sample = [a, b, c, d, e, f, g, h];
            self.participant.write(self.writer, &sample, None, now).ok();
        }
        self.participant.transmit(buf, now)
    }
}

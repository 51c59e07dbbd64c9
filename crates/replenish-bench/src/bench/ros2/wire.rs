//! `replenish-rtps` alone: one thread that drives a participant.

use super::ping::{LONGEST, Ping};
use crate::load::{MS, Nanos};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use replenish_rtps::participant::{EndpointSpec, ReaderId, WriterId};
use replenish_rtps::udp::{UdpConfig, UdpParticipant};
use replenish_rtps::wire::{CDR_LE, Encapsulated, Qos};
use std::net::Ipv4Addr;
use std::time::Duration;

const TYPE: &str = "std_msgs::msg::dds_::UInt8MultiArray_";

pub(super) struct Wire {
    node: UdpParticipant,
    writer: WriterId,
    reader: ReaderId,
    sample: Vec<u8>,
}

impl Wire {
    pub(super) fn open(domain: u16, pings: bool) -> Result<Self, Failure> {
        let peers: Vec<_> = UdpConfig::unicast(domain, Ipv4Addr::LOCALHOST, 4).collect();
        let config = UdpConfig {
            domain,
            multicast: false,
            peers: &peers,
            ..UdpConfig::default()
        };
        let mut node = UdpParticipant::open(&config).map_err(Failure::refused)?;
        let now = node.now();
        let (to, from) = if pings {
            ("rt/there", "rt/back")
        } else {
            ("rt/back", "rt/there")
        };
        let spec = |topic| EndpointSpec {
            qos: Qos::ros(),
            sample_bytes: LONGEST,
            samples: 10,
            ..EndpointSpec::new(topic, TYPE)
        };
        let ends = node.participant_mut();
        let writer = ends.create_writer(&spec(to), now);
        let reader = ends.create_reader(&spec(from), now);
        let mut sample = vec![0; LONGEST];
        for (to, from) in sample.iter_mut().zip(CDR_LE) {
            *to = from;
        }
        Ok(Self {
            writer: writer.map_err(Failure::refused)?,
            reader: reader.map_err(Failure::refused)?,
            node,
            sample,
        })
    }

    fn step(&mut self, patience: Nanos) -> Result<(), Failure> {
        let stepped = self.node.step(Duration::from_nanos(patience));
        stepped.map_err(Failure::refused)
    }

    /// Sends back what comes, until the process ends.
    pub(super) fn echo(mut self) -> Outcome {
        println!("ready");
        loop {
            let now = self.node.now();
            let participant = self.node.participant_mut();
            while let Some(sample) = participant.take(self.reader) {
                let len = sample.payload.len();
                let room = self.sample.get_mut(..len).unwrap_or_default();
                room.copy_from_slice(sample.payload);
                participant
                    .write(self.writer, room, None, now)
                    .map_err(Failure::refused)?;
            }
            self.step(100 * MS)?;
        }
    }
}

impl Ping for Wire {
    fn round_trip(
        &mut self,
        number: u64,
        bytes: usize,
        until: Nanos,
    ) -> Result<Option<Nanos>, Failure> {
        let now = self.node.now();
        let participant = self.node.participant_mut();
        let sample = self.sample.get_mut(..bytes + 4).unwrap_or_default();
        if let Some(stamp) = sample.get_mut(4..12) {
            stamp.copy_from_slice(&number.to_le_bytes());
        }
        participant
            .write(self.writer, sample, None, now)
            .map_err(Failure::refused)?;
        loop {
            let now = clock::monotonic();
            if now >= until {
                return Ok(None);
            }
            self.step(until - now)?;
            while let Some(sample) = self.node.participant_mut().take(self.reader) {
                let cdr = Encapsulated::decode(sample.payload).map_err(Failure::refused)?;
                if cdr.data.first_chunk::<8>() == Some(&number.to_le_bytes()) {
                    return Ok(Some(clock::monotonic()));
                }
            }
        }
    }

    fn idle(&mut self) -> Result<bool, Failure> {
        self.step(5 * MS)?;
        Ok(true)
    }
}

//! One run: a load of samples from a sender to a receiver.

use super::link::{Air, Direction, Link};
use replenish_xrce::stream::{
    InputReliable, OutputReliable, OutputStats, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Encode, Message, MessageWriter, ObjectId, ObjectKind, RequestId,
    SessionId, StreamId, WriteData,
};
use replenish_xrce::{Nanos, SeqNum};

const MTU: usize = 512;
const RING: usize = 128;
const WINDOW: usize = 16;
/// A power of two above the window.
const IN_FLIGHT: usize = 32;
const LONGEST: usize = 65_528;

/// The samples to send: number and sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// Number of samples.
    pub samples: u32,
    /// Bytes of the shortest one, at least 4.
    pub shortest: usize,
    /// Bytes of the longest of the usual ones.
    pub usual: usize,
    /// Bytes of the large ones, up to 65528.
    pub large: usize,
    /// Every so-many-th sample is a large one; 0 for none.
    pub large_every: u32,
}

impl Load {
    /// Sample `i`: its number and a pattern, of a length that depends on the number.
    #[must_use]
    pub fn sample(&self, i: u32) -> Vec<u8> {
        let is_large = i.checked_rem(self.large_every) == Some(self.large_every / 2);
        let spread = self.usual.saturating_sub(self.shortest).saturating_add(1);
        let usual = usize::try_from(i.wrapping_mul(0x9e37_79b9)).unwrap_or(0);
        let usual = usual.checked_rem(spread).unwrap_or(0);
        let len = if is_large {
            self.large
        } else {
            self.shortest.saturating_add(usual)
        };
        let [low, ..] = i.to_le_bytes();
        let number = i.to_le_bytes().into_iter();
        let pattern = (0..=255).cycle().map(|at: u8| at.wrapping_mul(low | 1));
        number.chain(pattern).take(len.clamp(4, LONGEST)).collect()
    }
}

/// The sender's answer to a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// With what is missing: what this crate does.
    Selective,
    /// With everything that is not acknowledged. At most once in the longest round trip the link
    /// can have, which the sender knows here: a sender that does not know it sends far more.
    GoBackN,
}

/// The outcome of a run: counts, duration, and a digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Samples written.
    pub sent: u64,
    /// Samples that arrived unharmed and in their turn.
    pub delivered: u64,
    /// Samples that arrived again.
    pub duplicated: u64,
    /// Samples that did not arrive, or not unharmed.
    pub lost: u64,
    /// The counters of the sender.
    pub stats: OutputStats,
    /// Datagrams of the sender, heartbeats included, that the link has lost.
    pub datagrams_lost: u64,
    /// Time at which everything was acknowledged.
    pub duration: Nanos,
    /// A digest of everything that was sent and when.
    pub trace: u64,
}

impl Outcome {
    /// Samples for each second of virtual time.
    #[must_use]
    pub fn messages_per_second(&self) -> f64 {
        self.delivered as f64 * 1e9 / (self.duration.max(1) as f64)
    }
}

struct Run {
    load: Load,
    repair: Repair,
    longest_round_trip: Nanos,
    /// Times at which each message in flight was last sent, by the low bits of its number.
    sent_at: [Nanos; IN_FLIGHT],
    output: OutputReliable<Vec<u8>, RING>,
    input: InputReliable<Vec<u8>, Vec<u8>, WINDOW>,
    air: Air,
    now: Nanos,
    written: u32,
    /// The next sample that is due at the receiver.
    due: u32,
    outcome: Outcome,
}

/// Sends a load over a link; ends when everything was acknowledged or nothing more happens.
#[must_use]
pub fn transfer(seed: u64, link: Link, load: Load, repair: Repair) -> Outcome {
    let header = StreamHeader {
        session: SessionId(0x81),
        stream: StreamId::RELIABLE,
        key: ClientKey([1; 4]),
    };
    let (ring, config) = (vec![0; RING.saturating_mul(MTU)], Reliability::default());
    let slots = vec![0; WINDOW.saturating_mul(MTU)];
    let fragments = vec![0; LONGEST.saturating_add(8)];
    let mut run = Run {
        load,
        repair,
        longest_round_trip: link.delay_max.saturating_mul(2),
        sent_at: [0; IN_FLIGHT],
        output: OutputReliable::new(ring, MTU, header, Tail::Padded, config)
            .with_spill(fragments.clone()),
        input: InputReliable::new(StreamId::RELIABLE, slots, MTU, fragments),
        air: Air::new(link, seed),
        now: 0,
        written: 0,
        due: 0,
        outcome: Outcome {
            sent: 0,
            delivered: 0,
            duplicated: 0,
            lost: 0,
            stats: OutputStats::default(),
            datagrams_lost: 0,
            duration: 0,
            trace: seed,
        },
    };
    while run.written < load.samples || !run.output.is_idle() {
        run.write();
        run.transmit();
        if !run.step() {
            break;
        }
    }
    let missing = load.samples.saturating_sub(run.due);
    let outcome = &mut run.outcome;
    outcome.lost = outcome.lost.saturating_add(missing.into());
    outcome.sent = run.written.into();
    Outcome {
        stats: run.output.stats(),
        datagrams_lost: run.air.lost,
        duration: run.now,
        ..run.outcome
    }
}

impl Run {
    /// Writes as much as the stream takes.
    fn write(&mut self) {
        while self.written < self.load.samples {
            let payload = self.load.sample(self.written);
            let base = BaseRequest {
                request: RequestId::FIRST,
                object: ObjectId::new(1, ObjectKind::DataWriter),
            };
            let body = WriteData {
                base,
                payload: &payload,
            };
            match self.output.push(&body) {
                Ok(()) | Err(PushError::TooLarge { .. } | PushError::Wire(_)) => {
                    self.written = self.written.saturating_add(1);
                }
                Err(PushError::WouldBlock) => return,
            }
        }
    }

    fn transmit(&mut self) {
        while let Some(bytes) = self.output.next_datagram(self.now) {
            note(&mut self.outcome.trace, self.now, bytes);
            self.air.send(self.now, Direction::Forth, bytes);
            if let Ok(message) = Message::parse(bytes)
                && let Some(sent_at) = self.sent_at.get_mut(in_flight(message.header.seq))
            {
                *sent_at = self.now;
            }
        }
        if let Some(heartbeat) = self.output.take_heartbeat(self.now) {
            self.control(Direction::Forth, &heartbeat);
        }
        if let Some(ack) = self.input.take_ack() {
            self.control(Direction::Back, &ack);
        }
    }

    /// Goes to the next arrival or timer; false if there is none.
    fn step(&mut self) -> bool {
        let arrival = self.air.next_arrival();
        let timer = self.output.next_deadline();
        let Some(next) = arrival.into_iter().chain(timer).min() else {
            return false;
        };
        self.now = self.now.max(next);
        if arrival.is_some_and(|arrival| arrival <= self.now)
            && let Some((direction, bytes)) = self.air.land()
            && let Ok(message) = Message::parse(&bytes)
        {
            match direction {
                Direction::Forth => self.receive(&message),
                Direction::Back => self.acknowledge(&message),
            }
        }
        true
    }

    fn receive(&mut self, message: &Message<'_>) {
        if !message.header.stream.is_reliable() {
            for submessage in message.submessages().map_while(Result::ok) {
                if let Ok(Body::Heartbeat(heartbeat)) = submessage.body() {
                    self.input.heartbeat(heartbeat.last);
                }
            }
            return;
        }
        let (load, due, outcome) = (self.load, &mut self.due, &mut self.outcome);
        self.input
            .receive(message.header.seq, message.body, |submessage| {
                if let Ok(Body::WriteData(data)) = submessage.body() {
                    judge(load, due, outcome, data.payload);
                }
            });
    }

    fn acknowledge(&mut self, message: &Message<'_>) {
        for submessage in message.submessages().map_while(Result::ok) {
            if let Ok(Body::AckNack(ack)) = submessage.body() {
                let missing = match self.repair {
                    Repair::Selective => ack.missing,
                    Repair::GoBackN => self.everything(ack.first_unacked, ack.missing),
                };
                self.output
                    .acknowledge(self.now, ack.first_unacked, missing);
            }
        }
    }

    /// The repairs of a go-back-N sender: everything, if the first gap is certain to be one.
    fn everything(&self, first_unacked: SeqNum, missing: u16) -> u16 {
        let gap = u16::try_from(missing.trailing_zeros()).unwrap_or(0);
        let sent_at = self.sent_at.get(in_flight(first_unacked.plus(gap)));
        let since = self.now.saturating_sub(sent_at.copied().unwrap_or(0));
        if missing != 0 && since >= self.longest_round_trip {
            u16::MAX
        } else {
            0
        }
    }

    fn control(&mut self, direction: Direction, body: &impl Encode) {
        let header = StreamHeader {
            stream: StreamId::NONE,
            ..self.output.header()
        };
        let mut buf = [0; 32];
        let message = MessageWriter::new(&mut buf, &header.at(SeqNum(0)))
            .and_then(|mut writer| writer.push(body).map(|()| writer.finish()));
        if let Ok(bytes) = message {
            note(&mut self.outcome.trace, self.now, bytes);
            self.air.send(self.now, direction, bytes);
        }
    }
}

fn in_flight(seq: SeqNum) -> usize {
    usize::from(seq.0).checked_rem(IN_FLIGHT).unwrap_or(0)
}

/// Is it the sample whose turn it is?
fn judge(load: Load, due: &mut u32, outcome: &mut Outcome, payload: &[u8]) {
    let number = payload
        .first_chunk()
        .map_or(u32::MAX, |number| u32::from_le_bytes(*number));
    if number < *due {
        outcome.duplicated = outcome.duplicated.saturating_add(1);
        return;
    }
    let skipped = number.saturating_sub(*due);
    outcome.lost = outcome.lost.saturating_add(skipped.into());
    *due = number.saturating_add(1);
    if payload == load.sample(number) {
        outcome.delivered = outcome.delivered.saturating_add(1);
    } else {
        outcome.lost = outcome.lost.saturating_add(1);
    }
}

/// FNV-1a over what is sent and when.
fn note(trace: &mut u64, now: Nanos, bytes: &[u8]) {
    for &byte in now.to_le_bytes().iter().chain(bytes) {
        *trace = (*trace ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
}

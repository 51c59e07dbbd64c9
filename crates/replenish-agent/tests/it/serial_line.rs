//! A client on a serial line of 115 200 baud that damages bytes, in virtual time: what it writes
//! goes up to the agent, and comes back down to its own reader.

use crate::session::{MS, WRITER, endpoints_of};
use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::client::{
    Buffers, Config, Event, PingPolicy, ReliableBuffers, Session, SessionState,
};
use replenish_xrce::framing::{
    SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame, serial_frame_len,
};
use replenish_xrce::stream::{AckPolicy, Reliability};
use replenish_xrce::wire::{ClientKey, StreamId};
use std::collections::VecDeque;

const SECOND: u64 = 1000 * MS;
/// Ten bits at 115 200 baud.
const BYTE: u64 = 86_806;
/// The lead by which the line's driver takes bytes.
const AHEAD: u64 = 2 * MS;
const MTU: usize = 512;

type Client = Session<Vec<u8>, 64, 32>;

/// xorshift64*.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16) % n
    }
}

/// A frame that was put on the line.
struct Sent {
    message: Vec<u8>,
    /// When its last byte arrives.
    end: u64,
    damaged: bool,
    arrived: bool,
}

/// One direction of the line.
struct Line {
    decoder: Serial<Vec<u8>>,
    from: u8,
    to: u8,
    /// Bytes and when the last of their bits is over; `None`: lost.
    bytes: VecDeque<(u64, Option<u8>)>,
    free_at: u64,
    /// Damages one byte in this many; 0 for none.
    damage: u64,
    random: Random,
    sent: Vec<Sent>,
}

impl Line {
    fn new(from: u8, to: u8, damage: u64, seed: u64) -> Self {
        Self {
            decoder: Serial::new(to, vec![0; MTU]),
            from,
            to,
            bytes: VecDeque::new(),
            free_at: 0,
            damage,
            random: Random(seed | 1),
            sent: Vec::new(),
        }
    }

    fn takes(&self, now: u64) -> bool {
        self.free_at <= now + AHEAD
    }

    fn send(&mut self, now: u64, message: &[u8]) {
        let mut frame = vec![0; serial_frame_len(message.len())];
        let len = serial_frame(self.from, self.to, message, &mut frame).unwrap();
        let mut at = self.free_at.max(now);
        let (mut damaged, mut end) = (false, at);
        for byte in &frame[..len] {
            let hit = self.damage > 0 && self.random.below(self.damage) == 0;
            damaged |= hit;
            // Changed, lost, or with another one after it.
            let how = if hit { 1 + self.random.below(4) } else { 0 };
            let noise = self.random.below(256) as u8;
            at += BYTE;
            let arrives = match how {
                1 | 2 => Some(byte ^ noise.max(1)),
                3 => None,
                _ => Some(*byte),
            };
            self.bytes.push_back((at, arrives));
            end = at;
            if how == 4 {
                at += BYTE;
                self.bytes.push_back((at, Some(noise)));
            }
        }
        self.free_at = at;
        let message = message.to_vec();
        self.sent.push(Sent {
            message,
            end,
            damaged,
            arrived: false,
        });
    }

    /// The messages that have arrived up to now.
    fn receive(&mut self, now: u64) -> Vec<Vec<u8>> {
        let mut messages = Vec::new();
        while let Some((at, byte)) = self.bytes.front().copied().filter(|(at, _)| *at <= now) {
            self.bytes.pop_front();
            let Some(byte) = byte else { continue };
            let sent = &mut self.sent;
            self.decoder.push(&[byte], |_, message| {
                let recent = sent.len().saturating_sub(8);
                let frame = sent[recent..].iter_mut().find(|frame| frame.end == at);
                let frame = frame.expect("a frame that nobody has sent");
                assert_eq!(frame.message, message, "a frame that nobody has sent");
                frame.arrived = true;
                messages.push(message.to_vec());
            });
        }
        messages
    }

    /// Intact frames that were lost in a row, at most.
    fn worst_recovery(&self) -> (usize, usize) {
        let (mut worst, mut run, mut damaged) = (0, 0, 0);
        let done = self.sent.len().saturating_sub(8);
        for sent in &self.sent[..done] {
            damaged += usize::from(sent.damaged);
            if sent.arrived {
                run = 0;
            } else if !sent.damaged {
                run += 1;
                worst = worst.max(run);
            }
        }
        (damaged, worst)
    }
}

struct World {
    now: u64,
    agent: AgentCore<u32>,
    client: Client,
    up: Line,
    down: Line,
    got: Vec<Vec<u8>>,
}

fn client() -> Client {
    let buffer = |len| vec![0; len];
    let config = Config {
        mtu: MTU as u16,
        confirm_delivery: true,
        ping: Some(PingPolicy {
            after: 300 * MS,
            silence_limit: 850 * MS,
        }),
        reliability: Reliability {
            heartbeat_first: 200 * MS,
            heartbeat_min: 20 * MS,
            heartbeat_max: 400 * MS,
            ..Reliability::default()
        },
        acks: AckPolicy::BATCHED,
        ..Config::new(ClientKey(*b"line"))
    };
    let buffers = Buffers {
        best_effort: [buffer(MTU)],
        reliable: [ReliableBuffers {
            output: buffer(64 * MTU),
            large_output: buffer(5000),
            input: buffer(16 * MTU),
            fragments: buffer(5000),
        }],
        restore: buffer(8 * MTU),
        journal: buffer(4096),
    };
    Session::new(config, buffers)
}

impl World {
    fn new(damage: u64, seed: u64) -> Self {
        let mut world = Self {
            now: 0,
            agent: AgentCore::new(Limits::DEFAULT),
            client: client(),
            up: Line::new(SERIAL_CLIENT, SERIAL_AGENT, 0, seed),
            down: Line::new(SERIAL_AGENT, SERIAL_CLIENT, 0, seed ^ 0x5555),
            got: Vec::new(),
        };
        world.client.connect(0);
        endpoints_of(&mut world.client, "echo", "echo", StreamId::RELIABLE);
        while world.client.state() != SessionState::Up {
            assert!(world.now < 20 * SECOND, "no session");
            world.step();
        }
        (world.up.damage, world.down.damage) = (damage, damage);
        world
    }

    /// A quarter of a millisecond.
    fn step(&mut self) {
        self.now += MS / 4;
        let now = Now {
            monotonic: self.now,
            unix: 0,
        };
        for message in self.up.receive(self.now) {
            self.agent.receive(now, 1, &message);
        }
        let got = &mut self.got;
        let mut keep = |event: Event<'_>| {
            if let Event::Data { payload, .. } = event {
                got.push(payload.to_vec());
            }
        };
        for message in self.down.receive(self.now) {
            self.client.handle(self.now, &message, &mut keep);
        }
        self.client.tick(self.now, &mut keep);
        let down = &mut self.down;
        while down.takes(self.now) {
            let mut sent = false;
            self.agent.pump(now, 1, &mut |_, bytes| {
                sent = true;
                down.send(now.monotonic, bytes);
            });
            if !sent {
                break;
            }
        }
        while self.up.takes(self.now)
            && let Some(bytes) = self.client.poll_transmit(self.now)
        {
            let bytes = bytes.to_vec();
            self.up.send(self.now, &bytes);
        }
    }

    /// Writes `count` samples of `len` bytes as fast as they are taken, until all are back; how
    /// long that took, and the longest time without one.
    fn all_come_back(&mut self, count: u32, len: usize) -> (u64, u64) {
        let start = self.now;
        let (mut longest, mut last, mut had) = (0, self.now, 0);
        let mut samples = (0..count).map(|number| sample(number, len)).peekable();
        while self.got.len() < count as usize {
            let mut write = |sample: &_| self.client.write(WRITER, StreamId::RELIABLE, sample);
            while samples.next_if(|sample| write(sample).is_ok()).is_some() {}
            self.step();
            if self.got.len() > had {
                longest = longest.max(self.now - last);
                (last, had) = (self.now, self.got.len());
            }
            assert!(
                self.now - start < 600 * SECOND,
                "only {} of {count}",
                self.got.len()
            );
        }
        (self.now - start, longest)
    }
}

fn sample(number: u32, len: usize) -> Vec<u8> {
    let bytes = (0..len).map(|i| (i as u32 * 31 + number * 7) as u8 | 0x5c);
    let mut sample: Vec<u8> = bytes.collect(); // much of it has to be escaped
    sample[..4].copy_from_slice(&number.to_le_bytes());
    sample
}

fn run(damage: u64, seed: u64, count: u32, len: usize) -> u64 {
    let mut world = World::new(damage, seed);
    let (took, longest) = world.all_come_back(count, len);
    let expected: Vec<Vec<u8>> = (0..count).map(|i| sample(i, len)).collect();
    assert!(world.got == expected, "each once, in order, unharmed");
    let (up, down) = (world.up.worst_recovery(), world.down.worst_recovery());
    let losses = world.client.link_stats().losses;
    println!(
        "1 of {damage} bytes, {count} x {len} bytes: {:.1} s, longest pause {:.2} s, \
         damaged frames and intact ones lost in a row: {up:?} up, {down:?} down, resent {} + {}, losses {losses}",
        took as f64 / 1e9,
        longest as f64 / 1e9,
        world.client.output_stats().resent,
        world.agent.stats().retransmitted,
    );
    assert!(up.1 <= 2 && down.1 <= 2, "recovery within three frames");
    assert_eq!(losses, 0, "damage is not the loss of the agent");
    took
}

#[test]
fn small_samples_come_back_whatever_is_damaged() {
    for (seed, damage) in [(1, 0), (2, 4000), (3, 1000), (4, 300)] {
        run(damage, seed, 200, 20);
    }
}

#[test]
fn large_samples_come_back_whatever_is_damaged() {
    let clean = run(0, 1, 20, 4096);
    for seed in 2..5 {
        let rough = run(4000, seed, 20, 4096);
        assert!(rough < 3 * clean);
        // Four frames of ten are damaged.
        let rough = run(1000, seed, 20, 4096);
        assert!(rough < 8 * clean);
    }
}

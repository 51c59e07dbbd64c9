//! Tracks as a Perfetto trace: `repeated TracePacket packet = 1`.
//!
//! Field numbers are those of Perfetto's `trace_packet.proto`, `track_descriptor.proto`,
//! `track_event.proto` and `clock_snapshot.proto`. Every track is a packet sequence of its own.
//! Time stamps are `CLOCK_MONOTONIC`; the first packet relates it to the other clocks, so that a
//! trace of the kernel of the same boot merges.

use super::protobuf::Message;
use super::tracks::{Entry, Through, What};
use replenish_recorder::Clocks;

/// Clock ids of Perfetto.
const REALTIME: u64 = 1;
const MONOTONIC: u64 = 3;
const BOOTTIME: u64 = 6;
/// `SEQ_INCREMENTAL_STATE_CLEARED`, `SEQ_NEEDS_INCREMENTAL_STATE`.
const CLEARED: u64 = 1;
const NEEDED: u64 = 2;
/// `CounterDescriptor.Unit.UNIT_TIME_NS`.
const NANOSECONDS: u64 = 1;

/// A trace under construction.
#[derive(Default)]
pub(super) struct Trace {
    bytes: Vec<u8>,
    /// Distinguishes the tracks of the present program from those of others.
    salt: u64,
    tracks: u64,
}

/// A track of the trace.
#[derive(Debug, Clone, Copy)]
pub(super) struct Track {
    uuid: u64,
    sequence: u64,
}

impl Trace {
    /// The tracks from now on are this program's.
    pub(super) fn program(&mut self, pid: u32, clocks: &[Clocks]) {
        let start = clocks.first().map_or(0, |c| c.monotonic);
        self.salt = (u64::from(pid) << 32 ^ start).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        for clocks in clocks {
            let clock = |id, time| Message::default().number(1, id).number(2, time);
            let snapshot = Message::default()
                .message(1, &clock(MONOTONIC, clocks.monotonic))
                .message(1, &clock(BOOTTIME, clocks.boottime))
                .message(1, &clock(REALTIME, clocks.realtime));
            let packet = Message::default()
                .number(8, clocks.monotonic)
                .number(58, MONOTONIC)
                .number(10, 1);
            self.packet(&packet.message(6, &snapshot));
        }
    }

    fn packet(&mut self, packet: &Message) {
        let packet = Message::default().message(1, packet);
        self.bytes.extend(packet.into_bytes());
    }

    fn track(&mut self, describe: impl FnOnce(Message) -> Message) -> Track {
        self.tracks += 1;
        let uuid = self
            .salt
            .wrapping_add(self.tracks.wrapping_mul(0x1234_5678_9abc_def1))
            | 1;
        let sequence = self.tracks + 1;
        let descriptor = describe(Message::default().number(1, uuid));
        let event = Message::default().number(11, uuid);
        let defaults = Message::default().number(58, MONOTONIC).message(11, &event);
        let packet = Message::default()
            .number(10, sequence)
            .number(13, CLEARED)
            .message(59, &defaults)
            .message(60, &descriptor);
        self.packet(&packet);
        Track { uuid, sequence }
    }

    pub(super) fn process(&mut self, pid: u32, name: &str) -> Track {
        let process = Message::default().number(1, u64::from(pid)).text(6, name);
        self.track(|track| track.message(3, &process))
    }

    pub(super) fn thread(&mut self, process: Track, pid: u32, tid: u64, name: &str) -> Track {
        let thread = Message::default()
            .number(1, u64::from(pid))
            .number(2, tid)
            .text(5, name);
        self.track(|track| track.number(5, process.uuid).message(4, &thread))
    }

    /// A counter in nanoseconds.
    pub(super) fn counter(&mut self, parent: Track, name: &str) -> Track {
        let counter = Message::default().number(3, NANOSECONDS);
        self.track(|track| {
            track
                .number(5, parent.uuid)
                .text(2, name)
                .message(8, &counter)
        })
    }

    pub(super) fn state(&mut self, parent: Track, name: &str) -> Track {
        let state = Message::default();
        self.track(|track| {
            track
                .number(5, parent.uuid)
                .text(2, name)
                .message(18, &state)
        })
    }

    pub(super) fn entries(&mut self, track: Track, entries: &[Entry]) {
        for entry in entries {
            let packet = Message::default()
                .number(8, entry.time)
                .number(10, track.sequence)
                .number(13, NEEDED)
                .message(11, &event(&entry.what));
            self.packet(&packet);
        }
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// A `TrackEvent`: its type in field 9, its name in field 23.
fn event(what: &What) -> Message {
    let of = |kind| Message::default().number(9, kind);
    match what {
        What::Begin { name, flow } => {
            let event = of(1).text(23, name).text(22, "callback");
            flow.map_or_else(|| of(1).text(23, name), |flow| event.fixed(48, flow))
        }
        What::End => of(2),
        What::Instant {
            kind,
            name,
            value,
            flow,
        } => {
            let mut event = of(3).text(22, kind).text(23, name);
            if let Some((name, value)) = value {
                let annotation = Message::default().text(10, name).number(3, *value);
                event = event.message(4, &annotation);
            }
            match flow {
                Some(Through::On(flow)) => event.fixed(47, *flow),
                Some(Through::End(flow)) => event.fixed(48, *flow),
                None => event,
            }
        }
        What::Left(left) => of(4).number(30, *left),
        What::Level(name) => of(5).text(23, name),
    }
}

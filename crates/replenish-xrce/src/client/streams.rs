//! The streams of a session: any number of best-effort and reliable ones, each with both
//! directions.
//!
//! ```text
//!   index          0        1       ..
//!   best effort   0x01     0x02     ..        higher indices are sent first:
//!   reliable      0x80     0x81     ..        a backlog of one never delays those above it
//! ```
//!
//! Requests go on one of the reliable streams. After a new log-in they must arrive before the
//! samples that were kept from the session before; they then go through `restore`, which begins
//! that stream, and the kept samples follow with the numbers after them.

use super::restore::Restore;
use super::stream_set::StreamSet;
use super::{Config, ReliableBuffers, WriteError};
use crate::stream::{
    BestEffortStats, Carried, InputBestEffort, InputReliable, InputStats, OutputBestEffort,
    OutputReliable, OutputStats, PushError, StreamHeader, Tail,
};
use crate::time::{NEVER, Nanos};
use crate::wire::{AckNack, Confirmed, Heartbeat, RawBody, SessionId, StreamId};
use core::array::from_fn;

#[derive(Debug)]
pub(super) struct BestEffort<S> {
    pub(super) output: OutputBestEffort<S>,
    pub(super) input: InputBestEffort,
}

#[derive(Debug)]
pub(super) struct Reliable<S, const N: usize> {
    pub(super) output: OutputReliable<S, N>,
    pub(super) input: InputReliable<S, S, N>,
}

#[derive(Debug)]
pub(super) struct Streams<S, const N: usize, const B: usize, const R: usize> {
    best_effort: StreamSet<BestEffort<S>, B>,
    reliable: StreamSet<Reliable<S, N>, R>,
    /// The stream of requests.
    requests: StreamId,
    restore: Restore<S, N>,
}

pub(super) const fn header(config: &Config, session: SessionId, stream: StreamId) -> StreamHeader {
    StreamHeader {
        session,
        stream,
        key: config.key,
    }
}

fn number(index: usize) -> u8 {
    u8::try_from(index).unwrap_or(u8::MAX)
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> BestEffort<S> {
    fn new(config: &Config, index: usize, out: S) -> Self {
        let head = header(config, config.session, StreamId::best_effort(number(index)));
        BestEffort {
            output: OutputBestEffort::new(out, head, Tail::Padded).limited(config.mtu.into()),
            input: InputBestEffort::new(),
        }
    }
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize> Reliable<S, N> {
    fn new(config: &Config, index: usize, buffers: ReliableBuffers<S>, keeps: bool) -> Self {
        let (stream, mtu) = (StreamId::reliable(number(index)), config.mtu.into());
        let (ring, head) = (buffers.output, header(config, config.session, stream));
        let output = OutputReliable::new(ring, mtu, head, Tail::Padded, config.reliability)
            .with_spill(buffers.large_output);
        Reliable {
            output: if keeps {
                output.keeping_whole_samples()
            } else {
                output
            },
            input: InputReliable::new(stream, buffers.input, mtu, buffers.fragments)
                .acknowledging(config.acks),
        }
    }
}

/// The stream of requests while the session is restored.
fn restoring<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize>(
    config: &Config,
    buf: S,
) -> Restore<S, N> {
    let head = header(config, config.session, StreamId::RELIABLE);
    Restore::new(buf, config.mtu.into(), head, config.reliability)
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize, const B: usize, const R: usize>
    Streams<S, N, B, R>
{
    /// The streams, whose storage is asked for by their indices, best effort first.
    pub(super) fn new(
        config: &Config,
        restore: S,
        mut best_effort: impl FnMut(usize) -> S,
        mut reliable: impl FnMut(usize) -> ReliableBuffers<S>,
    ) -> Self {
        let keeps = Restore::<S, N>::keeps(&restore, config.mtu.into());
        Streams {
            best_effort: StreamSet(from_fn(|i| BestEffort::new(config, i, best_effort(i)))),
            reliable: StreamSet(from_fn(|i| Reliable::new(config, i, reliable(i), keeps))),
            requests: StreamId::RELIABLE,
            restore: restoring(config, restore),
        }
    }

    /// The streams, with storage that is there.
    pub(super) fn of(
        config: &Config,
        restore: S,
        best_effort: [S; B],
        reliable: [ReliableBuffers<S>; R],
    ) -> Self {
        let keeps = Restore::<S, N>::keeps(&restore, config.mtu.into());
        let (mut best, mut next) = (0..B, 0..R);
        let best_effort =
            best_effort.map(|out| BestEffort::new(config, best.next().unwrap_or_default(), out));
        let reliable = reliable
            .map(|kept| Reliable::new(config, next.next().unwrap_or_default(), kept, keeps));
        Streams {
            best_effort: StreamSet(best_effort),
            reliable: StreamSet(reliable),
            requests: StreamId::RELIABLE,
            restore: restoring(config, restore),
        }
    }

    /// A new session begins: input streams from the start, output streams with the samples that
    /// were not acknowledged, if there is a way to bring them over.
    pub(super) fn begin(&mut self, config: &Config, session: SessionId, confirms: bool) -> Carried {
        let head = |stream| header(config, session, stream);
        self.best_effort.for_each(|stream| {
            let id = stream.output.header().stream;
            stream.output.reset(head(id));
            stream.input.reset();
        });
        let keeps = self.restore.limit() > 0;
        let mut all = Carried::default();
        self.reliable.for_each(|stream| {
            let id = stream.output.header().stream;
            let carried = stream.output.carry_over(head(id));
            all.lost = all.lost.saturating_add(carried.lost);
            if keeps {
                all.samples = all.samples.saturating_add(carried.samples);
            } else {
                all.lost = all.lost.saturating_add(carried.samples);
                stream.output.reset(head(id));
            }
            stream.output.until_confirmed(confirms);
            stream.input.reset();
        });
        self.requests = config.requests;
        self.restore
            .begin(head(config.requests), all.samples > 0 && keeps);
        all
    }

    /// The objects exist again: the samples may follow.
    pub(super) fn resume(&mut self) {
        if let Some(next) = self.restore.end()
            && let Some(stream) = self.reliable_mut(self.requests)
        {
            stream.output.start_at(next);
        }
    }

    /// Whether all requests of a restoration were acknowledged.
    pub(super) fn is_restored(&self) -> bool {
        self.restore.is_idle()
    }

    /// Gives up unacknowledged samples; returns their number.
    pub(super) fn give_up(&mut self) -> u64 {
        let mut lost = 0_u64;
        self.reliable.for_each(|Reliable { output, .. }| {
            let header = output.header();
            let carried = output.carry_over(header);
            lost = lost.saturating_add(carried.samples.saturating_add(carried.lost));
            output.reset(header);
        });
        lost
    }

    /// Pushes a sample's submessage.
    pub(super) fn write(
        &mut self,
        stream: StreamId,
        body: &RawBody<'_>,
        size: usize,
    ) -> Result<(), WriteError> {
        let pushed = if let Some(stream) = self.reliable_mut(stream) {
            stream.output.push(body)
        } else if let Some(stream) = self.best_effort_mut(stream) {
            stream.output.push(body)
        } else {
            return Err(WriteError::UnknownStream(stream));
        };
        pushed.map_err(|error| WriteError::from_push(error, size))
    }

    /// Pushes a request.
    pub(super) fn request(&mut self, body: &RawBody<'_>) -> Result<(), PushError> {
        if let Some(restore) = self.restore.active() {
            return restore.push(body);
        }
        match self.reliable_mut(self.requests) {
            Some(stream) => stream.output.push(body),
            None => Err(PushError::TooLarge { size: 0, limit: 0 }),
        }
    }

    /// The largest request, submessage header included, that can be sent whatever happens.
    pub(super) fn request_limit(&self) -> usize {
        let limit = self.limit(self.requests).unwrap_or(0);
        let limit = limit.wrapping_add(WriteError::OVERHEAD);
        match self.restore.limit() {
            0 => limit,
            restore => limit.min(restore),
        }
    }

    /// The largest sample on `stream`.
    pub(super) fn limit(&self, stream: StreamId) -> Option<usize> {
        let reliable = self.reliable.get(stream.reliable_index());
        let best_effort = self.best_effort.get(stream.best_effort_index());
        let limit = match (reliable, best_effort) {
            (Some(stream), _) => stream.output.limit(),
            (_, Some(stream)) => stream.output.limit(),
            _ => return None,
        };
        Some(limit.saturating_sub(WriteError::OVERHEAD))
    }

    pub(super) fn best_effort_mut(&mut self, stream: StreamId) -> Option<&mut BestEffort<S>> {
        self.best_effort.get_mut(stream.best_effort_index())
    }

    pub(super) fn reliable_mut(&mut self, stream: StreamId) -> Option<&mut Reliable<S, N>> {
        self.reliable.get_mut(stream.reliable_index())
    }

    pub(super) fn acknowledge(&mut self, now: Nanos, ack: &AckNack, confirmed: Option<Confirmed>) {
        let is_request = ack.stream == self.requests;
        let output = match self.restore.active().filter(|_| is_request) {
            Some(restore) => restore,
            None => {
                let index = ack.stream.reliable_index();
                let Some(stream) = self.reliable.get_mut(index) else {
                    return;
                };
                &mut stream.output
            }
        };
        output.acknowledge(now, ack.first_unacked, ack.missing);
        if let Some(confirmed) = confirmed {
            output.confirm(now, confirmed.first_unconfirmed);
        }
    }

    pub(super) fn take_ack(&mut self, now: Nanos) -> Option<AckNack> {
        self.reliable.first(|stream| stream.input.take_ack_at(now))
    }

    pub(super) fn take_heartbeat(&mut self, now: Nanos) -> Option<Heartbeat> {
        if let Some(restore) = self.restore.active() {
            return restore.take_heartbeat(now);
        }
        self.reliable
            .first(|stream| stream.output.take_heartbeat(now))
    }

    /// The next message of a stream, those with higher indices first, best effort before reliable.
    pub(super) fn next_message(&mut self, now: Nanos) -> Option<&[u8]> {
        if let Some(message) = self.best_effort.first(|stream| stream.output.take()) {
            return Some(message);
        }
        if self.restore.is_active() {
            return self.restore.active()?.next_datagram(now);
        }
        self.reliable
            .first(|stream| stream.output.next_datagram(now))
    }

    /// Time at which a stream has something to send; [`NEVER`] for no time.
    pub(super) fn deadline(&self) -> Nanos {
        let restoring = self.restore.is_active();
        self.reliable.sum(self.restore.deadline(), |next, stream| {
            let output = if restoring {
                NEVER
            } else {
                stream.output.deadline()
            };
            next.min(stream.input.ack_due_at()).min(output)
        })
    }

    /// Whether every sample was acknowledged.
    pub(super) fn is_delivered(&self) -> bool {
        self.reliable
            .sum(true, |all, stream| all && stream.output.is_idle())
    }

    /// Whether samples of `stream` will be sent again in the next session.
    pub(super) fn carries(&self, stream: StreamId) -> bool {
        let stream = self.reliable.get(stream.reliable_index());
        self.restore.limit() > 0 && stream.is_some_and(|stream| !stream.output.is_idle())
    }

    pub(super) fn unacknowledged(&self) -> usize {
        self.reliable.sum(0, |sum: usize, stream| {
            sum.saturating_add(stream.output.unacknowledged())
        })
    }

    pub(super) fn output_stats(&self) -> OutputStats {
        self.reliable.sum(self.restore.stats(), |sum, stream| {
            sum.plus(stream.output.stats())
        })
    }

    pub(super) fn input_stats(&self) -> (InputStats, BestEffortStats) {
        let reliable = |sum: InputStats, s: &Reliable<S, N>| sum.plus(s.input.stats());
        let best_effort = |sum: BestEffortStats, s: &BestEffort<S>| sum.plus(s.input.stats());
        (
            self.reliable.sum(InputStats::default(), reliable),
            self.best_effort
                .sum(BestEffortStats::default(), best_effort),
        )
    }

    pub(super) fn stream_stats(&self, stream: StreamId) -> Option<(OutputStats, InputStats)> {
        let stream = self.reliable.get(stream.reliable_index())?;
        Some((stream.output.stats(), stream.input.stats()))
    }
}

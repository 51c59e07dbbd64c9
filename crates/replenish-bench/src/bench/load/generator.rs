//! The clients: a few threads, each with some of them.
//!
//! A thread waits for its sockets and for the next tick; at its tick a client writes one sample on
//! each of its topics. Ticks are spread over the period, as those of independent clients are.

use crate::load::{MS, Nanos, SEC};
use crate::load_client::{Client, Endpoint};
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::{PollFd, clock, poll};
use replenish_xrce::stream::AckPolicy;
use replenish_xrce::wire::StreamId;
use std::net::SocketAddr;
use std::sync::Barrier;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Time in ns for samples to arrive after the last was written.
const DRAIN: Nanos = 10 * SEC;

/// The longest set-up, in ns.
const SET_UP: Nanos = 20 * SEC;

/// Datagrams taken from one socket before the others have their turn.
const BATCH: usize = 32;

/// Samples that the agent keeps for a reader before it drops: ten seconds at 100 Hz, so that what
/// counts as lost is not a moment in which the machine did something else.
pub(super) const DEPTH: u16 = 1000;

/// The load that the clients offer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    pub(super) clients: u16,
    pub(super) topics: u16,
    /// Between two samples of a topic.
    pub(super) period: Nanos,
    /// On each topic.
    pub(super) samples: u64,
    pub(super) bytes: usize,
}

impl Load {
    /// Samples of all topics.
    pub(super) fn total(&self) -> u64 {
        u64::from(self.clients) * u64::from(self.topics) * self.samples
    }
}

/// Counts of samples and messages, of one thread's clients or of all.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub(super) sent: u64,
    pub(super) received: u64,
    pub(super) duplicated: u64,
    pub(super) reordered: u64,
    /// Writes that had to wait because the stream was full.
    pub(super) blocked: u64,
    /// Messages that clients sent again.
    pub(super) resent: u64,
    /// Clients that lost the agent.
    pub(super) disconnected: u64,
    /// From due to received, in microseconds.
    pub(super) latencies: Vec<u32>,
    /// From the first sample due to the last one received.
    pub(super) duration: Nanos,
}

/// Offers the load; calls `watch` once a second with the time since it began.
pub(super) fn run(
    load: &Load,
    threads: u16,
    agent: SocketAddr,
    stop: &Stop,
    mut watch: impl FnMut(Nanos),
) -> Result<Tally, Failure> {
    let threads = threads.min(load.clients);
    // All threads are ready; then all know the epoch.
    let (ready, go) = (
        Barrier::new(usize::from(threads) + 1),
        Barrier::new(usize::from(threads) + 1),
    );
    let epoch = AtomicU64::new(0);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|thread| {
                let (ready, go, epoch) = (&ready, &go, &epoch);
                scope.spawn(move || {
                    let fleet = Fleet::set_up(load, thread, threads, agent);
                    ready.wait();
                    go.wait();
                    fleet?.run(epoch.load(Ordering::Acquire), stop)
                })
            })
            .collect();
        ready.wait();
        let begin = clock::monotonic() + 100 * MS;
        epoch.store(begin, Ordering::Release);
        go.wait();
        while workers.iter().any(|worker| !worker.is_finished()) {
            watch(clock::monotonic().saturating_sub(begin));
            let pause = Duration::from_millis(if load.samples * load.period < 10 * SEC {
                100
            } else {
                1000
            });
            stop.wait(pause);
        }
        let mut all = Tally::default();
        for worker in workers {
            let tally = worker
                .join()
                .map_err(|_| Failure::refused("a client's thread panicked"))??;
            all.add(tally);
        }
        Ok(all)
    })
}

impl Tally {
    fn add(&mut self, other: Tally) {
        self.sent += other.sent;
        self.received += other.received;
        self.duplicated += other.duplicated;
        self.reordered += other.reordered;
        self.blocked += other.blocked;
        self.resent += other.resent;
        self.disconnected += other.disconnected;
        self.latencies.extend(other.latencies);
        self.duration = self.duration.max(other.duration);
    }
}

/// The clients of one thread.
struct Fleet<'a> {
    load: &'a Load,
    members: Vec<Member>,
}

/// One client and its account.
struct Member {
    client: Client,
    /// Its place among all, for its tick.
    index: u64,
    /// Samples written so far on each topic.
    written: Vec<u64>,
    /// The number expected next on each topic.
    expected: Vec<u64>,
}

impl<'a> Fleet<'a> {
    /// Connects the clients of `thread`.
    fn set_up(
        load: &'a Load,
        thread: u16,
        threads: u16,
        agent: SocketAddr,
    ) -> Result<Self, Failure> {
        let mine = (0..load.clients).filter(|client| client % threads == thread);
        let mut members = Vec::new();
        for index in mine {
            // Acknowledging every message at once would double the datagrams.
            let acks = AckPolicy {
                every: 4,
                delay: 2 * MS,
            };
            let mut client = Client::connect(agent, 0x6c64_0000 + u32::from(index), acks)?;
            let name = |client: u16, topic: u16| format!("load/{client}/{topic}");
            let before = (index + load.clients - 1) % load.clients;
            let topics = 0..load.topics;
            let names: Vec<_> = topics
                .map(|topic| (topic + 1, name(index, topic), name(before, topic)))
                .collect();
            let depth = DEPTH;
            let writers: Vec<_> = names
                .iter()
                .map(|(number, topic, _)| endpoint(*number, topic, depth))
                .collect();
            let readers: Vec<_> = names
                .iter()
                .map(|(number, _, topic)| endpoint(*number, topic, depth))
                .collect();
            client.equip(&writers, &readers, StreamId::RELIABLE)?;
            members.push(Member {
                client,
                index: index.into(),
                written: vec![0; load.topics.into()],
                expected: vec![0; load.topics.into()],
            });
        }
        let until = clock::monotonic() + SET_UP;
        for member in &mut members {
            let left = until.saturating_sub(clock::monotonic());
            member.client.await_up(left)?;
        }
        Ok(Self { load, members })
    }

    /// Offers the load from `epoch` on; ends when everything has come or nothing more does.
    fn run(mut self, epoch: Nanos, stop: &Stop) -> Result<Tally, Failure> {
        let load = *self.load;
        let mut tally = Tally::default();
        let each = usize::try_from(load.samples).unwrap_or(0) * usize::from(load.topics);
        tally.latencies.reserve(each * self.members.len());
        let mut payload = vec![0_u8; load.bytes];
        let mine = (each * self.members.len()) as u64;
        let last_due = epoch + load.samples * load.period;
        let mut ready = vec![true; self.members.len()];
        loop {
            let now = clock::monotonic();
            let mut next = now + 100 * MS;
            for (member, ready) in self.members.iter_mut().zip(&ready) {
                if *ready {
                    member.receive(&mut tally)?;
                }
                let due = member.write(&load, epoch, now, &mut payload, &mut tally)?;
                let wakes = due.into_iter().chain(member.client.deadline());
                next = wakes.fold(next, u64::min);
            }
            let acknowledged = || self.members.iter().all(|m| m.client.is_delivered());
            let whole = tally.received >= mine && tally.sent >= mine && acknowledged();
            let over = clock::monotonic() >= last_due + DRAIN;
            if whole || over || stop.is_triggered() {
                break;
            }
            let mut fds: Vec<_> = self
                .members
                .iter()
                .map(|m| PollFd::readable(m.client.transport()))
                .collect();
            poll(&mut fds, Some(next)).map_err(Failure::refused)?;
            for (ready, fd) in ready.iter_mut().zip(&fds) {
                *ready = fd.is_ready();
            }
        }
        tally.duration = clock::monotonic().saturating_sub(epoch);
        for member in &self.members {
            tally.resent += member.client.resent();
            tally.disconnected += u64::from(member.client.has_lost_agent());
        }
        Ok(tally)
    }
}

fn endpoint(number: u16, topic: &str, depth: u16) -> Endpoint<'_> {
    Endpoint {
        number,
        topic,
        depth,
    }
}

impl Member {
    /// Takes what has come, up to some limit.
    fn receive(&mut self, tally: &mut Tally) -> Result<(), Failure> {
        let expected = &mut self.expected;
        for _ in 0..BATCH {
            let now = clock::monotonic();
            let mut data = |reader: u16, payload: &[u8]| {
                count(expected, tally, now, reader, payload);
            };
            if !self.client.receive(now, &mut data)? {
                break;
            }
        }
        Ok(())
    }

    /// Writes what is due and sends what there is; when the next sample is due.
    fn write(
        &mut self,
        load: &Load,
        epoch: Nanos,
        now: Nanos,
        payload: &mut [u8],
        tally: &mut Tally,
    ) -> Result<Option<Nanos>, Failure> {
        let offset = load.period * self.index / u64::from(load.clients);
        let at = |number: u64| epoch + offset + number * load.period;
        let mut next = None;
        for (topic, written) in (1..).zip(&mut self.written) {
            while *written < load.samples && at(*written) <= now {
                let due = at(*written);
                if let Some((number, rest)) = payload.split_first_chunk_mut::<8>()
                    && let Some(stamp) = rest.first_chunk_mut::<8>()
                {
                    *number = written.to_le_bytes();
                    *stamp = due.to_le_bytes();
                }
                if !self.client.write(topic, StreamId::RELIABLE, payload)? {
                    tally.blocked += 1;
                    break;
                }
                *written += 1;
                tally.sent += 1;
            }
            // A blocked write goes on when an acknowledgement comes, which wakes the thread.
            if *written < load.samples && at(*written) > now {
                next = next.into_iter().chain([at(*written)]).min();
            }
        }
        let expected = &mut self.expected;
        let mut data = |reader: u16, payload: &[u8]| {
            count(expected, tally, now, reader, payload);
        };
        self.client.send(now, &mut data)?;
        Ok(next)
    }
}

/// Takes a received sample into the account.
fn count(expected: &mut [u64], tally: &mut Tally, now: Nanos, reader: u16, payload: &[u8]) {
    let topic = usize::from(reader).wrapping_sub(1);
    let (Some(expected), Some((number, rest))) =
        (expected.get_mut(topic), payload.split_first_chunk::<8>())
    else {
        return;
    };
    let number = u64::from_le_bytes(*number);
    let due = rest
        .first_chunk::<8>()
        .map_or(now, |stamp| u64::from_le_bytes(*stamp));
    if number < *expected {
        tally.duplicated += 1;
        return;
    }
    // A gap is a loss, unless what is missing comes later, which then counts as a duplicate: either
    // way the sums do not match.
    tally.reordered += u64::from(number > *expected);
    *expected = number + 1;
    tally.received += 1;
    let latency = now.saturating_sub(due) / 1000;
    tally
        .latencies
        .push(u32::try_from(latency).unwrap_or(u32::MAX));
}

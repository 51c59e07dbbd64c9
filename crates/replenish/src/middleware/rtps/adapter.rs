//! The adapter: a participant of ROS 2 as a [`Middleware`].

use super::config::RtpsError;
use super::graph::Graph;
use super::inlets::{ALARM, BATCH, Inlets, READERS, SHARED, WAKER};
use super::new_end::{NewEnd, failed};
use super::shared::Segments;
use super::state::{Round, State};
use super::stats::RtpsStats;
use crate::Nanos;
use crate::middleware::watch::{End, Watch};
use crate::middleware::{
    EndpointSpec, GraphEnd, IncompatibleQos, Interest, LinkState, Middleware, MiddlewareError,
    PublishError, ReaderId, RequestIdentity, Room, SampleInfo, ServiceSpec, Source, SourceSet,
    WriterId,
};
use crate::sync::{Arc, AtomicBool, AtomicUsize, Ordering};
use alloc::boxed::Box;
use core::fmt;
use replenish_os::timer::TimerFd;
use replenish_os::{PiMutex, SocketSet, WakeFd, clock};
use replenish_rtps::udp::{OpenError, Sockets, UdpConfig};
use std::io;
use std::net::UdpSocket;

/// Of the participant's sockets the one that does not hear of other participants.
const SAMPLES: usize = 2;

/// Datagrams that one round of housekeeping sends; more wait for the next one.
const DATAGRAMS: usize = 1024;

/// A participant of ROS 2 (RTPS 2.x over UDP), without an agent and without threads.
///
/// ```no_run
/// use replenish::middleware::rtps::{Rtps, RtpsConfig};
/// let participant = Rtps::open(&RtpsConfig::default())?;
/// # Ok::<(), replenish::middleware::rtps::RtpsError>(())
/// ```
///
/// Discovery, acknowledgements and repairs are the dispatcher's work: they happen while an executor
/// spins. Dropping it says goodbye.
pub struct Rtps {
    pub(super) state: Arc<PiMutex<State>>,
    pub(super) inlets: PiMutex<Inlets>,
    pub(super) sockets: Sockets,
    pub(super) set: SocketSet,
    pub(super) alarm: TimerFd,
    pub(super) own_endpoints: usize,
    /// No other participant is listened to.
    alone: bool,
    /// Long samples go through memory that is shared with others on this host.
    pub(super) is_shared: bool,
    pub(super) waker: Arc<WakeFd>,
    /// Samples wait in the participant.
    pub(super) backlog: Arc<AtomicBool>,
    /// A dispatcher has waited once: it looks after discovery.
    dispatched: AtomicBool,
    news: AtomicUsize,
}

impl Rtps {
    pub(super) fn over(
        config: &UdpConfig<'_>,
        alone: bool,
        is_shared: bool,
    ) -> Result<Self, RtpsError> {
        let io = |what| move |source| RtpsError::Io { what, source };
        let sockets = Sockets::open(config).map_err(RtpsError::Open)?;
        let now = clock::monotonic();
        let participant = sockets.participant(config, now);
        let mut participant = participant.map_err(RtpsError::Open)?;
        let graph = Graph::new(&mut participant, &config.limits, now);
        let graph = graph.map_err(|error| RtpsError::Open(OpenError::Config(error)))?;
        let set = SocketSet::new().map_err(io("make a wait set"))?;
        let waker = WakeFd::new().map_err(io("make a waker"))?;
        let alarm = TimerFd::new().map_err(io("make a timer"))?;
        let add = || -> io::Result<()> {
            set.add(&waker, WAKER, true)?;
            set.add(&alarm, ALARM, true)?;
            for (key, socket) in (SHARED..).zip(listened(&sockets, alone)) {
                if let Some(socket) = socket {
                    set.add(socket, key, true)?;
                }
            }
            Ok(())
        };
        add().map_err(io("wait for sockets"))?;
        let segments = Segments::new(is_shared);
        let mut state = State::new(participant, graph, config.longest_datagram(), segments);
        state.housekeep(clock::monotonic(), &alarm, &sockets);
        Ok(Self {
            state: Arc::new(PiMutex::new(state)),
            inlets: PiMutex::new(Inlets::new()),
            sockets,
            set,
            alarm,
            own_endpoints: config.limits.own_endpoints,
            alone,
            is_shared,
            waker: Arc::new(waker),
            backlog: Arc::new(AtomicBool::new(false)),
            dispatched: AtomicBool::new(false),
            news: AtomicUsize::new(0),
        })
    }

    /// The counters so far.
    #[must_use]
    pub fn stats(&self) -> RtpsStats {
        let state = self.state.lock();
        RtpsStats {
            dropped: state.readers.iter().map(|end| end.dropped).sum(),
            participants: state.participant.participants().count(),
            ..state.stats
        }
    }

    /// Receives at a socket of the participant: discovery, acknowledgements, and what is sent to a
    /// reader although it has another address.
    fn receive_shared(&self, inlets: &mut Inlets, socket: &UdpSocket, round: &mut Round<'_, '_>) {
        let mut most = BATCH;
        for taken in 0..BATCH {
            if taken >= most {
                return;
            }
            let Some(datagram) = inlets.receive_from(socket) else {
                return;
            };
            let now = clock::monotonic();
            let mut state = self.state.lock();
            state.receive(datagram, now);
            drop(State::fetch_all(&self.state, state, None));
            self.hand_over_all(round, now);
            if taken == 0 {
                most = inlets.batch(now);
            }
        }
    }

    /// Hands over the samples of every reader of interest.
    fn hand_over_all(&self, round: &mut Round<'_, '_>, now: Nanos) {
        let mut state = self.state.lock();
        for at in 0..state.readers.len() {
            if let Some(name) = u16::try_from(at)
                .ok()
                .and_then(|at| state.taken_here(ReaderId(at)))
            {
                state = State::hand_over_all_of(&self.state, state, name, round, (now, now));
            }
        }
    }

    /// As [`receive_shared`](Self::receive_shared), while there is CPU time left for discovery.
    fn receive_discovery(
        &self,
        inlets: &mut Inlets,
        socket: &UdpSocket,
        round: &mut Round<'_, '_>,
    ) {
        let mut before = clock::thread_cpu();
        for _ in 0..BATCH {
            let now = clock::monotonic();
            if inlets.allowance.resumes_at(now).is_some() {
                return;
            }
            let Some(datagram) = inlets.receive_from(socket) else {
                return;
            };
            self.state.lock().receive(datagram, now);
            self.hand_over_all(round, now);
            let after = clock::thread_cpu();
            inlets.allowance.spend(after.saturating_sub(before), now);
            before = after;
        }
    }

    fn receive_reader(&self, inlets: &mut Inlets, reader: ReaderId, round: &mut Round<'_, '_>) {
        let mut most = BATCH;
        for taken in 0..BATCH {
            // A datagram for a reader without room waits in the socket.
            if taken >= most || !round.interest.contains(reader) {
                return;
            }
            let Some((datagram, drops)) = inlets.receive(reader) else {
                return;
            };
            let now = clock::monotonic();
            let mut state = self.state.lock();
            let Some(name) = state.taken_here(reader) else {
                return;
            };
            state.count_drops(name, drops);
            state.receive(datagram, now);
            let state = State::fetch_all(&self.state, state, None);
            let times = (now, now);
            drop(State::hand_over_all_of(
                &self.state,
                state,
                name,
                round,
                times,
            ));
            if taken == 0 {
                most = inlets.batch(now);
            }
        }
    }

    /// Sends what is due, and keeps what the executor is to be told.
    fn housekeep(&self, rung: bool) {
        let now = clock::monotonic();
        let mut state = self.state.lock();
        if rung {
            state.rung(now, &self.alarm);
        }
        let news = state.notice(now);
        if state.segments.has_changed && state.segments.is_used {
            drop(state);
            self.look_after_segments();
            state = self.state.lock();
        }
        if state.is_due(now) {
            for _ in 0..DATAGRAMS {
                let sent = state.send_next(now, &self.sockets);
                // A thread that publishes has its turn after each datagram.
                drop(state);
                state = self.state.lock();
                if !sent {
                    break;
                }
            }
        }
        state.arm_next(now, &self.alarm);
        self.backlog.store(state.nudge_owners(), Ordering::Release);
        let watched = !state.watches.is_empty();
        drop(state);
        if news {
            self.news.fetch_add(1, Ordering::Release);
        }
        if watched {
            self.tell_watches();
        }
    }

    /// Where no dispatcher has begun, whoever waits for a peer has to listen to it.
    pub(super) fn look_after_discovery(&self) {
        if self.dispatched.load(Ordering::Acquire) {
            return;
        }
        let mut nobody = Interest::empty();
        let mut round = Round {
            interest: &mut nobody,
            sink: &mut |_, _, _| Room::Left,
            taken: 0,
        };
        if let Some(mut inlets) = self.inlets.try_lock() {
            for socket in listened(&self.sockets, self.alone).into_iter().flatten() {
                self.receive_shared(&mut inlets, socket, &mut round);
            }
        }
        self.housekeep(true);
    }
}

/// The sockets of the participant that are received from: without discovery nobody is found.
const fn listened(sockets: &Sockets, alone: bool) -> [Option<&UdpSocket>; 4] {
    let [group, discovery, user, group6] = sockets.all();
    if alone {
        [None, None, user, None]
    } else {
        [group, discovery, user, group6]
    }
}

impl Middleware for Rtps {
    fn create_writer(&self, spec: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError> {
        self.add_writer(&NewEnd::topic(spec)?)
    }

    fn create_reader(&self, spec: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError> {
        self.add_reader(&NewEnd::topic(spec)?)
    }

    fn is_ros(&self) -> bool {
        true
    }

    fn has_sources(&self) -> bool {
        true
    }

    fn source(&self, reader: ReaderId, set: &SourceSet, key: u32) -> Option<Box<dyn Source>> {
        self.give_away(reader, set, key)
    }

    fn delete_reader(&self, reader: ReaderId) -> Result<(), MiddlewareError> {
        self.remove_reader(reader);
        Ok(())
    }

    fn delete_writer(&self, writer: WriterId) {
        self.remove_writer(writer);
    }

    fn publish(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError> {
        self.look_after_discovery();
        self.send_sample(writer, payload)
    }

    fn publish_with(
        &self,
        writer: WriterId,
        encode: &mut dyn FnMut(&mut [u8]) -> Option<usize>,
    ) -> Option<Result<(), PublishError>> {
        self.look_after_discovery();
        self.encode_sample(writer, encode)
    }

    fn create_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        self.set_up_server(spec)
    }

    fn create_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        self.set_up_client(spec)
    }

    fn request(&self, client: WriterId, payload: &[u8]) -> Result<u64, PublishError> {
        self.send_request(client, payload)
    }

    fn reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        self.send_reply(server, to, payload)
    }

    fn has_server(&self, client: WriterId) -> Option<bool> {
        self.knows_server(client)
    }

    fn matched_readers(&self, writer: WriterId) -> Option<usize> {
        self.count_readers(writer)
    }

    fn graph(&self, each: &mut dyn FnMut(&GraphEnd<'_>)) -> bool {
        self.every_end(each);
        true
    }

    fn nodes(&self, each: &mut dyn FnMut(&str)) {
        self.every_node(each);
    }

    fn matched_writers(&self, reader: ReaderId) -> Option<usize> {
        self.count_writers(reader)
    }

    fn next_incompatible_qos(&self) -> Option<IncompatibleQos> {
        self.state.lock().clashes.pop_front()
    }

    fn watch(&self, end: End, watch: &Arc<dyn Watch>) -> Result<(), MiddlewareError> {
        self.add_watch(end, watch)
    }

    fn assert_liveliness(&self, writer: WriterId) -> Result<(), PublishError> {
        let now = clock::monotonic();
        let id = {
            let mut state = self.state.lock();
            let (id, _) = state.writer(writer, 0)?;
            state.participant.assert_liveliness(id, now);
            id
        };
        self.send_of(id, now);
        Ok(())
    }

    fn wait(&self, interest: &Interest, deadline: Option<Nanos>) -> Result<(), MiddlewareError> {
        self.dispatched.store(true, Ordering::Release);
        if self.backlog.load(Ordering::Acquire) && self.state.lock().has_sample(interest) {
            return Ok(());
        }
        let error = |error: io::Error| failed("wait for the participant's sockets", &error);
        let resumes = {
            let mut inlets = self.inlets.lock();
            inlets.follow(&self.set, interest).map_err(error)?;
            let [group, discovery, _, group6] = listened(&self.sockets, self.alone);
            let now = clock::monotonic();
            inlets.begin_wait(now);
            let resumes = inlets.follow_discovery(&self.set, [group, discovery, None, group6], now);
            resumes.map_err(error)?
        };
        let until = deadline.into_iter().chain(resumes).min();
        let mut keys = [0; SocketSet::MOST];
        let count = self.set.wait(until, &mut keys).map_err(error)?;
        if keys.iter().take(count).any(|key| *key == WAKER) {
            self.waker.clear();
        }
        self.inlets.lock().found(&keys, count);
        Ok(())
    }

    fn take(
        &self,
        interest: &mut Interest,
        sink: &mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    ) -> Result<usize, MiddlewareError> {
        let mut round = Round {
            interest,
            sink,
            taken: 0,
        };
        if self.backlog.load(Ordering::Acquire) {
            let now = clock::monotonic();
            self.hand_over_all(&mut round, now);
        }
        let mut rung = false;
        let mut inlets = self.inlets.lock();
        while let Some(key) = inlets.next_ready() {
            let reader = key
                .checked_sub(READERS)
                .and_then(|at| u16::try_from(at).ok());
            let shared = key
                .checked_sub(SHARED)
                .and_then(|at| usize::try_from(at).ok());
            if let Some(reader) = reader {
                self.receive_reader(&mut inlets, ReaderId(reader), &mut round);
            } else if let Some(at) = shared {
                let socket = self.sockets.all().get(at).copied().flatten();
                match socket {
                    Some(socket) if at != SAMPLES => {
                        self.receive_discovery(&mut inlets, socket, &mut round);
                    }
                    Some(socket) => self.receive_shared(&mut inlets, socket, &mut round),
                    None => {}
                }
            } else {
                rung |= key == ALARM;
            }
        }
        drop(inlets);
        let taken = round.taken;
        self.housekeep(rung);
        Ok(taken)
    }

    fn wake(&self) {
        self.waker.wake();
    }

    fn status_generation(&self) -> Option<usize> {
        Some(self.news.load(Ordering::Acquire))
    }

    fn link(&self) -> LinkState {
        LinkState::Up
    }

    fn memory(&self, reader: ReaderId) -> usize {
        let state = self.state.lock();
        let end = state.readers.get(usize::from(reader.0));
        end.map_or(0, |end| end.memory)
    }

    fn lost(&self, reader: ReaderId) -> u64 {
        self.state.lock().lost(reader)
    }
}

impl Drop for Rtps {
    fn drop(&mut self) {
        let now = clock::monotonic();
        let state = &mut *self.state.lock();
        state.participant.leave(now);
        state.housekeep(now, &self.alarm, &self.sockets);
    }
}

impl fmt::Debug for Rtps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Rtps")
            .field("stats", &self.stats())
            .finish_non_exhaustive()
    }
}

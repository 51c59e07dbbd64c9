//! The adapter: a participant of ROS 2 as a [`Middleware`].

use super::config::RtpsError;
use super::graph::Graph;
use super::inlets::{ALARM, BATCH, Inlets, NETWORK, READERS, SHARED, WAKER};
use super::network::Network;
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
use replenish_os::{PiMutex, SocketSet, WakeFd, clock, hear_joined_alone};
use replenish_rtps::participant::Part;
use replenish_rtps::udp::{OpenError, Sockets, UdpConfig};
use std::io;
use std::net::UdpSocket;
use std::os::fd::{AsFd, BorrowedFd};

/// The part whose CPU time each of the participant's sockets takes, and word of the host's
/// addresses: acknowledgements come to one.
const CHARGED: [Part; 5] = {
    let discovery = Part::Discovery;
    [discovery, discovery, Part::Repairs, discovery, discovery]
};

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
    /// The addresses may change; `None` if they were chosen, or nobody else is listened to.
    pub(super) network: Option<Network>,
    pub(super) set: SocketSet,
    pub(super) alarm: TimerFd,
    pub(super) own_endpoints: usize,
    /// No other participant is listened to.
    pub(super) alone: bool,
    /// Long samples go through memory that is shared with others on this host.
    pub(super) is_shared: bool,
    pub(super) waker: Arc<WakeFd>,
    /// Samples wait in the participant.
    pub(super) backlog: Arc<AtomicBool>,
    /// A dispatcher has waited once: it looks after discovery.
    pub(super) dispatched: AtomicBool,
    pub(super) news: AtomicUsize,
}

impl Rtps {
    pub(super) fn over(
        config: &UdpConfig<'_>,
        network: Option<Network>,
        (alone, is_shared): (bool, bool),
    ) -> Result<Self, RtpsError> {
        let io = |what| move |source| RtpsError::Io { what, source };
        let sockets = Sockets::open(config).map_err(RtpsError::Open)?;
        if !config.follows {
            let [group, _, _, group6] = sockets.all();
            for group in [group, group6].into_iter().flatten() {
                // For IPv6 not before Linux 4.20: then as if all were named.
                hear_joined_alone(group).unwrap_or_default();
            }
        }
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
            if let Some(network) = &network {
                set.add(&network.changes, NETWORK, true)?;
            }
            Ok(())
        };
        add().map_err(io("wait for sockets"))?;
        let segments = Segments::new(is_shared);
        let addresses = (config.longest_datagram(), config.used());
        let mut state = State::new(participant, graph, addresses, segments);
        state.housekeep(clock::monotonic(), &alarm, &sockets);
        Ok(Self {
            state: Arc::new(PiMutex::new(state)),
            inlets: PiMutex::new(Inlets::new()),
            sockets,
            network,
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

    /// The sockets whose CPU time is bounded, in the order of [`CHARGED`].
    fn charged_sockets(&self) -> [Option<BorrowedFd<'_>>; 5] {
        let shared = listened(&self.sockets, self.alone);
        let [group, discovery, user, group6] = shared.map(|socket| socket.map(AsFd::as_fd));
        let network = self.network.as_ref().map(|network| network.changes.as_fd());
        [group, discovery, user, group6, network]
    }

    /// The counters so far.
    #[must_use]
    pub fn stats(&self) -> RtpsStats {
        let state = self.state.lock();
        RtpsStats {
            dropped: state.readers.iter().map(|end| end.dropped).sum(),
            participants: state.participant.participants().count(),
            endpoints: state.participant.endpoints().count(),
            left_out: state.stats.left_out + state.graph.too_long(&state.participant),
            ..state.stats
        }
    }

    /// Receives at a socket of the participant: discovery, acknowledgements, and what is sent to a
    /// reader although it has another address.
    pub(super) fn receive_shared(
        &self,
        inlets: &mut Inlets,
        socket: &UdpSocket,
        round: &mut Round<'_, '_>,
    ) {
        let mut most = BATCH;
        for taken in 0..BATCH {
            if taken >= most {
                return;
            }
            let Some(datagram) = inlets.receive_from(socket) else {
                return;
            };
            let now = clock::monotonic();
            self.take_in(datagram, round, now);
            if taken == 0 {
                most = inlets.batch(now);
            }
        }
    }

    /// Takes a datagram in, and hands over what is ready then.
    pub(super) fn take_in(&self, datagram: &[u8], round: &mut Round<'_, '_>, now: Nanos) {
        let mut state = self.state.lock();
        state.receive(datagram, now);
        drop(State::fetch_all(&self.state, state, None));
        self.hand_over_all(round, now);
    }

    /// Hands over the samples of every reader of interest.
    pub(super) fn hand_over_all(&self, round: &mut Round<'_, '_>, now: Nanos) {
        let mut state = self.state.lock();
        if !state.has_any_sample() {
            return;
        }
        for at in 0..state.readers.len() {
            if let Some(name) = u16::try_from(at)
                .ok()
                .and_then(|at| state.taken_here(ReaderId(at)))
            {
                state = State::hand_over_all_of(&self.state, state, name, round, (now, now));
            }
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
}

/// The sockets of the participant that are received from: without discovery nobody is found.
pub(super) const fn listened(sockets: &Sockets, alone: bool) -> [Option<&UdpSocket>; 4] {
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

    fn enter_node(&self, node: &str) -> Result<(), MiddlewareError> {
        self.add_node(node)
    }

    fn leave_node(&self, node: &str) {
        self.remove_node(node);
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
            let sockets = self.charged_sockets();
            let now = clock::monotonic();
            inlets.begin_wait(now);
            let resumes = {
                let state = self.state.lock();
                CHARGED.map(|part| state.resumes_at(part, now))
            };
            let deaf = resumes.map(|at| at.is_some());
            inlets
                .follow_shared(&self.set, sockets, deaf)
                .map_err(error)?;
            resumes
        };
        let resumes = resumes.into_iter().flatten();
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
                if let (Some(socket), Some(part)) = (socket, CHARGED.get(at)) {
                    self.receive_within(*part, &mut inlets, socket, &mut round);
                }
            } else {
                rung |= key == ALARM;
            }
            if key == NETWORK {
                self.follow_network();
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

//! The adapter: a session with an agent as a [`Middleware`].

use super::config::Settings;
use super::errors::io_error;
use super::flags::StatusFlags;
use super::objects::{Round, State};
use super::socket_stats::SocketStats;
use super::transport::{Received, Transport};
use super::waiting::Waiting;
use crate::Nanos;
use crate::middleware::{
    EndpointSpec, IncompatibleQos, Interest, LinkState, Middleware, MiddlewareError, PublishError,
    ReaderId, RequestIdentity, Room, SampleInfo, ServiceSpec, WriterId,
};
use crate::platform::{DROPS, FULL, STD, Static, TEXTS, io, label};
use crate::qos::Qos;
use crate::sync::Arc;
use core::fmt;
use replenish_os::{PiMutex, clock};
use replenish_xrce::client::LinkStats;
use replenish_xrce::stream::{BestEffortStats, InputStats, OutputStats};
use replenish_xrce::wire::ObjectKind;

/// Datagrams handled in one [`Middleware::take`].
const BATCH: usize = 16;

/// A session with an XRCE agent.
///
/// ```no_run
/// use replenish::middleware::xrce::Xrce;
/// let agent = Xrce::udp("127.0.0.1:8888")?;
/// # Ok::<(), replenish::middleware::xrce::ConnectError>(())
/// ```
///
/// If the agent goes away, [`link`](Middleware::link) says so within a second, publishing fails
/// with [`PublishError::LinkDown`], and the session and everything in it come back with the agent.
/// Reliable samples that were taken and not acknowledged are then sent again; the agent may have
/// had some of them. [`XrceStats::link`] counts them.
/// Dropping it ends the session; on targets without an operating system, with feature `full`
/// only.
///
/// Something must call [`wait`](Middleware::wait) and [`take`](Middleware::take), as an executor
/// does: acknowledgements, heartbeats and pings happen there. Without that, best-effort samples
/// go out all the same, reliable ones until the window is full, and the loss of the agent is not
/// noticed.
pub struct Xrce {
    pub(super) settings: Settings,
    pub(super) transport: Arc<dyn Transport>,
    pub(super) waiting: Waiting,
    pub(super) state: PiMutex<Static<State>>,
    pub(super) flags: Arc<StatusFlags>,
}

/// The counters of an adapter and its session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct XrceStats {
    /// Log-ins, losses, pings.
    pub link: LinkStats,
    /// Reliable datagrams sent and sent again.
    pub output: OutputStats,
    /// Reliable datagrams received.
    pub reliable_input: InputStats,
    /// Best-effort datagrams received.
    pub best_effort_input: BestEffortStats,
    /// Trouble at the socket.
    pub socket: SocketStats,
    /// Reliable datagrams that are not acknowledged at this moment.
    pub unacknowledged: usize,
}

impl Xrce {
    /// The counters so far.
    #[must_use]
    pub fn stats(&self) -> XrceStats {
        let state = self.state.lock();
        let (reliable_input, best_effort_input) = state.session.input_stats();
        XrceStats {
            link: state.session.link_stats(),
            output: state.session.output_stats(),
            reliable_input,
            best_effort_input,
            socket: state.socket,
            unacknowledged: state.session.unacknowledged(),
        }
    }

    /// Receives and handles messages, up to a batch; whether the session is to be looked after now.
    /// The first came at `woken`.
    pub(super) fn receive(
        &self,
        round: &mut Round<'_, '_>,
        mut woken: Option<Nanos>,
    ) -> io::Result<bool> {
        let (mut any, mut due) = (false, false);
        for _ in 0..self.waiting.batch(BATCH) {
            // All messages of one reading have the same arrival time.
            let mut begun = None;
            let received = self.transport.receive(&mut |message| {
                let (now, state) = begun.get_or_insert_with(|| {
                    let now = woken.take().unwrap_or_else(clock::monotonic);
                    (now, self.state.lock())
                });
                if message.len() > usize::from(self.settings.mtu) {
                    state.socket.oversized += 1; // cut off by the transport
                } else {
                    due |= state.receive(*now, message, round);
                    any = true;
                }
            });
            drop(begun);
            match received? {
                Received::Something => {}
                Received::Nothing | Received::All => break,
                Received::Closed => {
                    self.state.lock().disconnected(clock::monotonic());
                    due = true;
                    break;
                }
            }
        }
        // A message was looked at with the clock in hand. Without one, and with a transport that
        // sends by and by, time or room alone may ask for something.
        Ok(due || !any || !self.waiting.is_for_datagrams())
    }

    /// Lets the session do what time asks for, and sends what there is to send.
    pub(super) fn housekeep(&self) {
        let now = clock::monotonic();
        let mut state = self.state.lock();
        state.tick(now);
        state.flush_deletes();
        state.grant();
        // The session counts a message that is not sent, and repeats it.
        state
            .flush(now, &*self.transport, self.waiting.alarm())
            .ok();
    }
}

impl Middleware for Xrce {
    fn create_writer(&self, spec: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError> {
        self.set_up(spec, true).map(WriterId)
    }

    fn create_reader(&self, spec: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError> {
        self.set_up(spec, false).map(ReaderId)
    }

    fn longest(&self, qos: &Qos, writes: bool) -> usize {
        if !STD {
            return usize::MAX; // a small board knows its messages
        }
        let state = self.state.lock();
        // Without any room the endpoint is refused with the setting that limits it.
        match state.longest(qos, &self.settings, writes) {
            0 => usize::MAX,
            longest => longest,
        }
    }

    fn delete_reader(&self, reader: ReaderId) -> Result<(), MiddlewareError> {
        if !FULL {
            return Err(MiddlewareError::Unsupported(label("deleting readers")));
        }
        let mut state = self.state.lock();
        state.delete_reader(reader);
        // A message that is not sent now goes out with the next round.
        state
            .flush(clock::monotonic(), &*self.transport, self.waiting.alarm())
            .ok();
        Ok(())
    }

    fn delete_writer(&self, writer: WriterId) {
        if !FULL {
            return;
        }
        let mut state = self.state.lock();
        state.delete_writer(writer);
        state
            .flush(clock::monotonic(), &*self.transport, self.waiting.alarm())
            .ok();
    }

    fn publish(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError> {
        let now = clock::monotonic();
        let mut state = self.state.lock();
        let sent = state.publish(now, writer, payload, &*self.transport, self.waiting.alarm());
        drop(state);
        if self.transport.wants_write() {
            self.waiting.wake(); // the dispatcher waits for the descriptor, but not to be written
        }
        sent
    }

    fn create_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        if !FULL {
            return Err(MiddlewareError::Unsupported(label("services")));
        }
        self.set_up_service(spec, ObjectKind::Replier)
    }

    fn create_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        if !FULL {
            return Err(MiddlewareError::Unsupported(label("services")));
        }
        self.set_up_service(spec, ObjectKind::Requester)
    }

    fn request(&self, client: WriterId, payload: &[u8]) -> Result<u64, PublishError> {
        if !FULL {
            return Err(PublishError::UnknownWriter);
        }
        self.send_service(clock::monotonic(), |state| state.request(client, payload))
    }

    fn reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        if !FULL {
            return Err(PublishError::UnknownWriter);
        }
        self.send_service(clock::monotonic(), |state| state.reply(server, to, payload))
    }

    fn has_server(&self, client: WriterId) -> Option<bool> {
        if !FULL {
            return None;
        }
        // A thread that waits for a server may be the only one that listens to the agent.
        let now = clock::monotonic();
        let mut known = None;
        let done = self.until(now, &mut |state| {
            known = state.is_served(client);
            true
        });
        done.ok().and(known)
    }

    fn next_incompatible_qos(&self) -> Option<IncompatibleQos> {
        if TEXTS && self.flags.has_clash() {
            self.state.lock().next_incompatible_qos()
        } else {
            None
        }
    }

    fn wait(&self, interest: &Interest, deadline: Option<Nanos>) -> Result<(), MiddlewareError> {
        if self.flags.has_backlog() && self.state.lock().has_sample(interest) {
            return Ok(());
        }
        self.waiting
            .dispatcher(&*self.transport, deadline)
            .map_err(|error| io_error(label("wait for the agent"), &error))
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
        if self.flags.has_backlog() {
            self.state.lock().take_backlog(&mut round, BATCH);
        }
        let received = self.receive(&mut round, self.waiting.ended());
        if !matches!(received, Ok(false)) {
            self.housekeep();
        }
        received
            .map(|_| round.taken)
            .map_err(|error| io_error(label("receive"), &error))
    }

    fn wake(&self) {
        self.waiting.wake();
    }

    fn status_generation(&self) -> Option<usize> {
        Some(self.flags.status_generation())
    }

    fn link(&self) -> LinkState {
        if self.flags.is_up() {
            LinkState::Up
        } else {
            LinkState::Down {
                since: self.state.lock().session.heard(),
            }
        }
    }

    fn lost(&self, reader: ReaderId) -> u64 {
        let state = self.state.lock();
        state
            .endpoints
            .readers
            .get(usize::from(reader.0))
            .map_or(0, |reader| reader.lost)
    }
}

impl Drop for Xrce {
    fn drop(&mut self) {
        if DROPS {
            // The agent forgets the session at once; if this is lost, after a while.
            self.state.lock().session.close(clock::monotonic());
            self.housekeep();
        }
    }
}

impl fmt::Debug for Xrce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Xrce")
            .field("transport", &self.transport)
            .field("link", &self.link())
            .finish_non_exhaustive()
    }
}

//! Connecting, and creating readers and writers: the only code here that waits for the agent.

use super::adapter::Xrce;
use super::config::{ConnectError, Settings, XrceConfig};
use super::errors::{io_error, request_error};
use super::limits::{OVERHEAD, RELIABLE_STREAMS, RESTORE, reorder};
use super::objects::{Round, State, XrceSession};
use super::time::wall_clock;
use super::transport::Transport;
use super::waiting::Waiting;
use crate::Nanos;
use crate::middleware::{EndpointSpec, Interest, MiddlewareError, ReaderId, Room, WriterId};
use crate::platform::{STD, StaticText, io, label, make_static, zeroed};
use crate::qos::Liveliness;
use crate::sync::Arc;
use alloc::boxed::Box;
use replenish_os::{PiMutex, clock};
use replenish_xrce::client::{Config, ReliableBuffers, Session};
use replenish_xrce::features::FRAGMENTS;
use replenish_xrce::wire::{ClientKey, ObjectId, StreamId};
use sporadic::{earliest, later};

/// The longest wait without a look at the session: a dispatcher may have received the answer.
const LOOK: Nanos = 5_000_000;

impl Xrce {
    /// Connects over a transport of your own to what you call `agent`.
    ///
    /// # Errors
    /// [`ConnectError`]; after [`XrceConfig::connect_timeout`] if nobody answers.
    pub fn over(
        agent: &str,
        transport: impl Transport,
        config: XrceConfig,
    ) -> Result<Self, ConnectError> {
        Self::connect(agent, Box::new(transport), config)
    }

    fn connect(
        agent: &str,
        transport: Box<dyn Transport>,
        config: XrceConfig,
    ) -> Result<Self, ConnectError> {
        config.check()?;
        let io = |what| move |source| ConnectError::Io { what, source };
        let waiting = Waiting::new(&*transport).map_err(io(label("create what is waited on")))?;
        let state = State::new(session(&config));
        let this = Self {
            settings: Settings {
                mtu: config.mtu,
                domain: config.domain,
                max_sample: config.max_sample,
                request_timeout: config.request_timeout,
            },
            waiting,
            transport: transport.into(),
            flags: Arc::clone(&state.endpoints.flags),
            state: PiMutex::new(make_static(state)),
        };
        let start = clock::monotonic();
        this.state.lock().session.connect(start);
        let deadline = later(start, config.connect_timeout);
        let waited = this.until(deadline, &mut |state| {
            state.endpoints.refused.is_some() || state.is_up()
        });
        waited.map_err(io(label("wait for the agent")))?;
        let (up, refused) = {
            let state = this.state.lock();
            (state.is_up(), state.endpoints.refused)
        };
        let agent = agent.into();
        match refused {
            Some(status) => Err(ConnectError::Refused { agent, status }),
            None if up => Ok(this),
            None => Err(ConnectError::NoAgent {
                agent,
                waited: config.connect_timeout,
            }),
        }
    }

    /// Creates a writer, or a reader; its id.
    pub(super) fn set_up(
        &self,
        spec: &EndpointSpec<'_>,
        writes: bool,
    ) -> Result<u16, MiddlewareError> {
        if STD && (spec.qos.lease.is_some() || spec.qos.liveliness != Liveliness::Automatic) {
            let what = label("liveliness, which no agent tells of: lease, liveliness");
            return Err(MiddlewareError::Unsupported(what));
        }
        let (id, object) = self.state.lock().add(spec, &self.settings, writes)?;
        let what = if writes {
            label("create a data writer")
        } else {
            label("create a data reader")
        };
        let confirmed = self.confirm(object, what);
        if confirmed.is_err() {
            let mut state = self.state.lock();
            if writes {
                state.delete_writer(WriterId(id));
            } else {
                state.delete_reader(ReaderId(id));
            }
        }
        confirmed.map(|()| id)
    }

    /// Waits until the agent has answered the creation of `object`.
    pub(super) fn confirm(
        &self,
        object: ObjectId,
        what: StaticText,
    ) -> Result<(), MiddlewareError> {
        let deadline = later(clock::monotonic(), self.settings.request_timeout);
        self.until(deadline, &mut |state| state.is_answered(object))
            .map_err(|error| io_error(label("wait for the agent"), &error))?;
        self.state.lock().outcome(object, what)
    }

    /// Runs the session until `done` or until `deadline` has passed.
    pub(super) fn until(
        &self,
        deadline: Nanos,
        done: &mut dyn FnMut(&State) -> bool,
    ) -> io::Result<()> {
        loop {
            let mut round = Round {
                interest: &mut Interest::empty(),
                sink: &mut |_, _, _| Room::Full,
                taken: 0,
            };
            self.receive(&mut round, None)?;
            self.housekeep();
            let now = clock::monotonic();
            let (done, backlog) = {
                let state = self.state.lock();
                (done(&state), state.has_backlog())
            };
            if backlog {
                self.waiting.wake(); // a dispatcher may want what has come meanwhile
            }
            if done || now >= deadline {
                return Ok(());
            }
            let glance = earliest(deadline, later(now, LOOK));
            self.waiting.other(&*self.transport, glance)?;
        }
    }

    /// Asks the agent for its wall-clock time; how many nanoseconds it is ahead of this machine's
    /// (of a board's monotonic clock: it has no other), give or take half the round trip. A program
    /// that wants to ask later keeps an `Arc` of the middleware, and gives the context a clone.
    ///
    /// # Errors
    /// [`MiddlewareError::LinkDown`]; [`MiddlewareError::NoAnswer`] after
    /// [`XrceConfig::request_timeout`]; [`MiddlewareError::Unsupported`] in builds without the
    /// feature `queries`, which `std` brings.
    pub fn agent_clock_offset(&self) -> Result<i64, MiddlewareError> {
        let sent = {
            let mut state = self.state.lock();
            state.endpoints.agent_time = None;
            state.session.request_time(wall_clock())
        };
        sent.map_err(|error| request_error(&error))?;
        let deadline = later(clock::monotonic(), self.settings.request_timeout);
        let what = label("the time");
        let mut ahead = None;
        self.until(deadline, &mut |state| {
            ahead = state.endpoints.agent_time;
            ahead.is_some()
        })
        .map_err(|error| io_error(label("wait for the agent"), &error))?;
        ahead.ok_or(MiddlewareError::NoAnswer { what })
    }
}

/// A session with its storage. (On its own: it is large, and is made on this function's stack.)
#[inline(never)]
fn session(config: &XrceConfig) -> Box<XrceSession> {
    let mtu = usize::from(config.mtu);
    // A sample that fits a message needs no room to be taken apart and put together.
    let sample = if FRAGMENTS && config.max_sample + OVERHEAD > mtu {
        (config.max_sample + 8).next_multiple_of(4)
    } else {
        0
    };
    let part = || {
        if FRAGMENTS {
            zeroed(sample)
        } else {
            Box::default()
        }
    };
    let reliable = |_| ReliableBuffers {
        output: zeroed(mtu * usize::from(config.window)),
        large_output: part(),
        input: zeroed(mtu * reorder(config.window.into())),
        fragments: part(),
    };
    let restore = match RESTORE {
        0 => Box::default(),
        _ => zeroed(mtu * RESTORE),
    };
    let session = Config {
        mtu: config.mtu,
        ping: Some(config.ping),
        reliability: config.reliability,
        acks: config.acks,
        requests: StreamId::reliable(RELIABLE_STREAMS as u8 - 1),
        confirm_delivery: true,
        ..Config::new(ClientKey(config.client_key()))
    };
    let journal = zeroed(config.journal);
    let out = |_| zeroed(mtu);
    Box::new(Session::from_fn(session, journal, restore, out, reliable))
}

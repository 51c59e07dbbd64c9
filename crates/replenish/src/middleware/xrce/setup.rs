//! Connecting, and creating readers and writers: the only code here that waits for the agent.

use super::state::{State, WINDOW};
use super::{ConnectError, XrceConfig, XrceUdp, io_error};
use crate::Nanos;
use crate::middleware::{EndpointSpec, Interest, MiddlewareError, ReaderId, Room, WriterId};
use alloc::boxed::Box;
use alloc::string::ToString;
use alloc::vec;
use replenish_os::timer::TimerFd;
use replenish_os::{PiMutex, PollFd, WakeFd, clock, poll};
use replenish_xrce::client::{Buffers, Config, ReliableBuffers, Session};
use replenish_xrce::udp::UdpTransport;
use replenish_xrce::wire::{ClientKey, ObjectId};
use std::io::{self, ErrorKind};
use std::net::ToSocketAddrs;

/// The longest wait without a look at the session: a dispatcher may have received the answer.
const GLANCE: Nanos = 5_000_000;
/// Messages that wait for a missing one; agents keep sixteen.
const REORDER: usize = 16;
/// Messages of requests on their way after a new log-in.
const RESTORE: usize = 16;
/// Bytes of journal: what `REQUESTS` descriptions with names of usual length need.
const JOURNAL: usize = 128 * 1024;

impl XrceUdp {
    /// Connects to the agent at `agent`, an address and port, with the default settings.
    ///
    /// # Errors
    /// [`ConnectError`]; after 1.5 s if nobody answers.
    pub fn connect(agent: &str) -> Result<Self, ConnectError> {
        Self::connect_with(agent, XrceConfig::default())
    }

    /// Connects to the agent at `agent`, an address and port.
    ///
    /// # Errors
    /// [`ConnectError`]; after [`XrceConfig::connect_timeout`] if nobody answers.
    pub fn connect_with(agent: &str, config: XrceConfig) -> Result<Self, ConnectError> {
        let session = session(&config)?;
        let address = |source| ConnectError::Address {
            agent: agent.to_string(),
            source,
        };
        let mut resolved = agent.to_socket_addrs().map_err(address)?;
        let none = || address(io::Error::from(ErrorKind::NotFound));
        let transport =
            UdpTransport::connect(resolved.next().ok_or_else(none)?).map_err(address)?;
        let io = |what| move |source| ConnectError::Io { what, source };
        let this = Self {
            config,
            transport,
            waker: WakeFd::new().map_err(io("create an eventfd"))?,
            timer: TimerFd::new().map_err(io("create a timer"))?,
            state: PiMutex::new(State::new(session)),
            inbox: PiMutex::new(vec![0; usize::from(config.mtu).saturating_add(1)].into()),
        };
        let start = clock::monotonic();
        this.state.lock().session.connect(start);
        let deadline = start.saturating_add(config.connect_timeout);
        let answer = this.until(deadline, |state| {
            let refused = state.refused.map(Err);
            refused.or(state.is_up().then_some(Ok(())))
        });
        let agent = agent.to_string();
        match answer {
            Ok(Some(Ok(()))) => Ok(this),
            Ok(Some(Err(status))) => Err(ConnectError::Refused { agent, status }),
            Ok(None) => Err(ConnectError::NoAgent {
                agent,
                waited: config.connect_timeout,
            }),
            Err(error) => Err(ConnectError::Io {
                what: "wait for the agent",
                source: error,
            }),
        }
    }

    pub(super) fn set_up_writer(
        &self,
        spec: &EndpointSpec<'_>,
    ) -> Result<WriterId, MiddlewareError> {
        let (id, object) = self.state.lock().add_writer(spec, self.config.domain)?;
        let confirmed = self.confirm(object, "create a data writer");
        if confirmed.is_err() {
            self.state.lock().abandon_writer(object);
        }
        confirmed.map(|()| id)
    }

    pub(super) fn set_up_reader(
        &self,
        spec: &EndpointSpec<'_>,
    ) -> Result<ReaderId, MiddlewareError> {
        let XrceConfig {
            domain,
            max_sample,
            mtu,
            ..
        } = self.config;
        let (id, object) = self
            .state
            .lock()
            .add_reader(spec, domain, max_sample, mtu)?;
        let confirmed = self.confirm(object, "create a data reader");
        if confirmed.is_err() {
            self.state.lock().abandon_reader(object);
        }
        confirmed.map(|()| id)
    }

    /// Waits until the agent has answered the creation of `object`.
    fn confirm(&self, object: ObjectId, what: &'static str) -> Result<(), MiddlewareError> {
        let deadline = clock::monotonic().saturating_add(self.config.request_timeout);
        self.until(deadline, |state| state.outcome(object, what))
            .map_err(|error| io_error("wait for the agent", &error))?
            .unwrap_or(Err(MiddlewareError::NoAnswer { what }))
    }

    /// Runs the session until `done` gives something or `deadline` has passed.
    fn until<T>(
        &self,
        deadline: Nanos,
        mut done: impl FnMut(&State) -> Option<T>,
    ) -> io::Result<Option<T>> {
        loop {
            let mut nobody = Interest::empty();
            let handled = self.receive(&mut nobody, &mut |_, _, _| Room::Full);
            if let Err(MiddlewareError::Io { errno, .. }) = handled {
                return Err(io::Error::from_raw_os_error(errno));
            }
            self.housekeep();
            let now = clock::monotonic();
            let (result, backlog) = {
                let state = self.state.lock();
                (done(&state), state.has_backlog())
            };
            if backlog {
                self.waker.wake(); // a dispatcher may want what has come meanwhile
            }
            if result.is_some() || now >= deadline {
                return Ok(result);
            }
            let glance = deadline.min(now.saturating_add(GLANCE));
            let mut fds = [
                PollFd::readable(&self.transport),
                PollFd::readable(&self.timer),
            ];
            poll(&mut fds, Some(glance))?;
        }
    }
}

/// A session with its storage.
fn session(config: &XrceConfig) -> Result<super::state::XrceSession, ConnectError> {
    let setting = |field, allowed| Err(ConnectError::Setting { field, allowed });
    if !(64..=65_507).contains(&config.mtu) {
        return setting("mtu", "from 64 to 65507 bytes");
    }
    if !(1..=WINDOW).contains(&usize::from(config.window)) {
        return setting("window", "from 1 to 64 datagrams");
    }
    if !(1..=65_528).contains(&config.max_sample) {
        return setting("max_sample", "from 1 to 65528 bytes");
    }
    if config.key == Some([0; 4]) {
        return setting("key", "other than 0, which the protocol reserves");
    }
    let mtu = usize::from(config.mtu);
    let bytes = |len: usize| -> Box<[u8]> { vec![0; len].into() };
    let sample = (config.max_sample + 8).next_multiple_of(4);
    let reliable = || ReliableBuffers {
        output: bytes(mtu * usize::from(config.window)),
        large_output: bytes(sample),
        input: bytes(mtu * REORDER),
        fragments: bytes(sample),
    };
    let buffers = Buffers {
        best_effort: [bytes(mtu), bytes(mtu)],
        reliable: [reliable(), reliable()],
        journal: bytes(JOURNAL),
        restore: bytes(mtu * RESTORE),
    };
    let session = Config {
        mtu: config.mtu,
        ping: Some(config.ping),
        reliability: config.reliability,
        ..Config::new(ClientKey(config.client_key()))
    };
    Ok(Session::new(session, buffers))
}

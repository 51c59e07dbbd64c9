//! The agent on a UDP socket: one thread that waits for a datagram or a deadline.
//!
//! ```text
//!   spawn / run ──► wait: datagram, deadline, or stop ──► receive ──► pump ──┐
//!                     ▲                                                      │
//!                     └──────────────────────────────────────────────────────┘
//! ```

mod port;
mod stop;

pub use stop::StopHandle;

use crate::agent_core::{AgentCore, Now};
use crate::config::{AgentConfig, Nanos};
use crate::error::AgentError;
use crate::stats::{Counters, Stats};
use port::{Arrival, Port};
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Datagrams sent in one go before the clock is read again.
const BATCH: usize = 64;

/// An agent that has its address and waits to be run.
#[derive(Debug)]
pub struct Agent {
    port: Port,
    core: AgentCore<SocketAddr>,
}

impl Agent {
    /// Takes the address; clients can send from now on and are answered once the agent runs.
    ///
    /// # Errors
    /// [`AgentError::AddressInUse`], or [`AgentError::Io`] for everything else the operating
    /// system can say.
    pub fn bind(config: &AgentConfig) -> Result<Self, AgentError> {
        config.validate()?;
        Ok(Self {
            port: Port::bind(config.addr)?,
            core: AgentCore::with(config),
        })
    }

    /// Where it listens, with the port that the operating system chose if 0 was asked for.
    #[must_use]
    pub fn local_addr(&self) -> SocketAddr {
        self.port.local_addr()
    }

    /// Runs in the calling thread until `stop` says so.
    ///
    /// # Errors
    /// [`AgentError::Io`] if the socket fails for good.
    pub fn run(&mut self, stop: &StopHandle) -> Result<(), AgentError> {
        let clock = Clock::new();
        let _listening = stop.listen_at(self.local_addr());
        while !stop.is_stopped() {
            let now = clock.now();
            let deadline = self.core.next_deadline();
            let wait = deadline.map(|deadline| deadline.saturating_sub(now.monotonic));
            if wait != Some(0) {
                match self.port.receive(wait)? {
                    Arrival::Nothing => {}
                    Arrival::Datagram(from, bytes) => self.core.receive(clock.now(), from, bytes),
                }
            }
            self.send_all(&clock);
        }
        Ok(())
    }

    /// Runs in a thread of its own, called `xrce-agent`.
    ///
    /// # Errors
    /// [`AgentError::Io`] if no thread can be had.
    pub fn spawn(mut self) -> Result<RunningAgent, AgentError> {
        let addr = self.local_addr();
        let stop = StopHandle::new();
        let counters = Arc::clone(self.core.counters());
        let handle = stop.clone();
        let thread = Builder::new()
            .name("xrce-agent".into())
            .spawn(move || self.run(&handle))
            .map_err(|error| AgentError::new("start a thread for the agent at", addr, error))?;
        Ok(RunningAgent {
            addr,
            stop,
            counters,
            thread: Some(thread),
        })
    }

    /// What was counted so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.core.stats()
    }

    fn send_all(&mut self, clock: &Clock) {
        let Self { port, core } = self;
        let counters = Arc::clone(core.counters());
        let mut send = |to: &SocketAddr, bytes: &[u8]| {
            if !port.send(*to, bytes) {
                counters.send_failed.hit();
            }
        };
        while core.pump(clock.now(), BATCH, &mut send) {}
    }
}

/// An agent that runs in a thread of its own. Dropping it stops it.
#[derive(Debug)]
pub struct RunningAgent {
    addr: SocketAddr,
    stop: StopHandle,
    counters: Arc<Counters>,
    thread: Option<JoinHandle<Result<(), AgentError>>>,
}

impl RunningAgent {
    /// Where it listens.
    #[must_use]
    pub fn local_addr(&self) -> SocketAddr {
        self.addr
    }

    /// What was counted so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.counters.snapshot()
    }

    /// Whether it still runs. It ends by itself only when its socket fails; [`stop`](Self::stop)
    /// then tells why.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.thread
            .as_ref()
            .is_some_and(|thread| !thread.is_finished())
    }

    /// Stops it and waits until its thread has ended and its address is free.
    ///
    /// # Errors
    /// What ended it before.
    pub fn stop(mut self) -> Result<Stats, AgentError> {
        self.join()?;
        Ok(self.stats())
    }

    fn join(&mut self) -> Result<(), AgentError> {
        self.stop.stop();
        match self.thread.take().map(JoinHandle::join) {
            None => Ok(()),
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }
}

impl Drop for RunningAgent {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            // What ended it before is lost here; `stop` tells it.
            drop(self.join());
        }
    }
}

/// Turns the clocks of the standard library into numbers.
struct Clock {
    start: Instant,
}

impl Clock {
    fn new() -> Self {
        Self {
            start: Instant::now(),
        }
    }

    fn now(&self) -> Now {
        let unix = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        Now {
            monotonic: Nanos::try_from(self.start.elapsed().as_nanos()).unwrap_or(Nanos::MAX),
            unix: i64::try_from(unix.as_nanos()).unwrap_or(i64::MAX),
        }
    }
}

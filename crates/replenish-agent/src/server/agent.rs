//! An agent with its transports, run by the calling thread or by one of its own.

use super::access::{AccessControl, AccessUpdate};
use super::clock::{instance, now};
use super::dds::DdsPort;
use super::inspector::{Inspector, SnapshotRequests};
use super::peer::Peer;
use super::ports::{Ports, Ready};
use super::running::RunningAgent;
use super::stop::StopHandle;
use crate::agent_core::AgentCore;
use crate::config::AgentConfig;
use crate::error::AgentError;
use crate::report::{Snapshot, Stats};
use replenish_os::{WakeFd, clock};
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::Builder;

/// Datagrams sent in one go before the clock is read again.
const BATCH: usize = 64;

/// An agent that has its addresses and waits to be run.
#[derive(Debug)]
pub struct Agent {
    ports: Ports,
    core: AgentCore<Peer>,
    wake: Arc<WakeFd>,
    requests: Arc<SnapshotRequests>,
    access: Arc<AccessUpdate>,
    dds: Option<DdsPort>,
}

impl Agent {
    /// Takes the addresses and opens the serial lines; clients can send from now on and are
    /// answered once the agent runs.
    ///
    /// # Errors
    /// [`AgentError::Config`], [`AgentError::AddressInUse`], [`AgentError::Serial`], or
    /// [`AgentError::Io`] for everything else the operating system can say.
    pub fn bind(config: &AgentConfig) -> Result<Self, AgentError> {
        config.validate()?;
        let ports = Ports::open(config, clock::monotonic())?;
        let wake = WakeFd::new()
            .map_err(|error| AgentError::new("make a wake-up for", config.addr, error))?;
        let wake = Arc::new(wake);
        let core = AgentCore::with(config).instance(instance());
        let core = core.hosts(Peer::host).connected(Peer::is_connected);
        let core = core.identities(Peer::identity);
        let (core, dds) = match &config.dds {
            Some(bridge) => (
                core.bridged(bridge.domain, bridge.dds.limits.topics),
                Some(DdsPort::start(bridge, &wake)?),
            ),
            None => (core, None),
        };
        Ok(Self {
            ports,
            core,
            wake,
            requests: Arc::default(),
            access: Arc::default(),
            dds,
        })
    }

    /// The first UDP address that it listens at, [`AgentConfig::addr`], with the port that the
    /// operating system chose if 0 was asked for. `0.0.0.0:0` if it does not listen for UDP.
    #[must_use]
    pub fn local_addr(&self) -> SocketAddr {
        let first = self.ports.udp_addrs().next();
        first.unwrap_or_else(|| (std::net::Ipv4Addr::UNSPECIFIED, 0).into())
    }

    /// All addresses at which it listens for UDP.
    #[must_use]
    pub fn udp_addrs(&self) -> Vec<SocketAddr> {
        self.ports.udp_addrs().collect()
    }

    /// The TCP address that it listens at, if any.
    #[must_use]
    pub fn tcp_addr(&self) -> Option<SocketAddr> {
        self.ports.tcp_addr()
    }

    /// The UDP address that it listens at for DTLS, if any.
    #[must_use]
    pub fn dtls_addr(&self) -> Option<SocketAddr> {
        self.ports.dtls_addr()
    }

    /// The TCP address that it listens at for TLS, if any.
    #[must_use]
    pub fn tls_addr(&self) -> Option<SocketAddr> {
        self.ports.tls_addr()
    }

    /// The SHA-256 of its own certificate, if it listens for TLS: `sha256:` and 64 digits.
    #[must_use]
    pub fn tls_fingerprint(&self) -> Option<String> {
        self.ports.tls_fingerprint()
    }

    /// Takes snapshots of the agent while it runs.
    #[must_use]
    pub fn inspector(&self) -> Inspector {
        let log = Arc::clone(self.core.log());
        let recordings = Arc::clone(self.core.recordings());
        let requests = Arc::clone(&self.requests);
        Inspector::new(Arc::clone(&self.wake), requests, log, recordings)
    }

    /// Replaces the access list while it runs.
    #[must_use]
    pub fn access_control(&self) -> AccessControl {
        AccessControl::new(Arc::clone(&self.wake), Arc::clone(&self.access))
    }

    /// Runs in the calling thread until `stop` says so.
    ///
    /// # Errors
    /// [`AgentError::Io`] if the UDP socket fails for good. Connections and serial lines that fail
    /// end the sessions on them; serial lines are opened again when they are back.
    pub fn run(&mut self, stop: &StopHandle) -> Result<(), AgentError> {
        let wake = Arc::clone(&self.wake);
        let _running = stop.runs(&wake);
        let mut ready = Vec::new();
        while !stop.is_stopped() {
            let waited = self
                .ports
                .wait(&wake, self.core.next_deadline(), &mut ready);
            waited.map_err(|error| AgentError::new("wait at", self.local_addr(), error))?;
            let Self { ports, core, .. } = self;
            for found in ready.drain(..) {
                match found {
                    Ready::Wake => drop(wake.clear()),
                    Ready::Udp(at) => ports.receive_udp(at, core, now, send_all)?,
                    Ready::Dtls => ports.receive_dtls(core, now, send_all)?,
                    Ready::TlsListener => ports.accept_tls(core, now().monotonic),
                    Ready::Listener => ports.accept(core, now().monotonic),
                    Ready::Read(at) => ports.read(at, core, now, send_all),
                    Ready::Write(at) => ports.write(at, core),
                }
                send_all(ports, core);
            }
            if let Some(list) = self.access.take() {
                ports.set_access(&list, core);
                core.set_access(now(), Some(list));
            }
            // After the wake-up was cleared, so that none is lost.
            if let Some(dds) = &mut self.dds {
                dds.take(core, now());
            }
            ports.upkeep(core, now().monotonic);
            send_all(ports, core);
            if let Some(dds) = &mut self.dds {
                dds.tell(core);
            }
            self.requests.answer(|| Snapshot {
                bridge: self.dds.as_ref().map(|dds| dds.snapshot(core)),
                ..core.snapshot(now())
            });
        }
        Ok(())
    }

    /// Runs in a thread of its own, called `xrce-agent`.
    ///
    /// # Errors
    /// [`AgentError::Io`] if no thread can be had.
    pub fn spawn(mut self) -> Result<RunningAgent, AgentError> {
        let addr = self.local_addr();
        let tcp = self.tcp_addr();
        let inspector = self.inspector();
        let access = self.access_control();
        let stop = StopHandle::new();
        let counters = Arc::clone(self.core.counters());
        let handle = stop.clone();
        let thread = Builder::new()
            .name("xrce-agent".into())
            .spawn(move || self.run(&handle))
            .map_err(|error| AgentError::new("start a thread for the agent at", addr, error))?;
        Ok(RunningAgent {
            addr,
            tcp,
            inspector,
            access,
            stop,
            counters,
            thread: Some(thread),
        })
    }

    /// The counters so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.core.stats()
    }
}

/// Sends all that can be sent now: one datagram at a time where links can get full, so that
/// datagrams for a full link stay where their order can still change.
fn send_all(ports: &mut Ports, core: &mut AgentCore<Peer>) {
    let counters = Arc::clone(core.counters());
    loop {
        if ports.has_links() {
            ports.update_held_links(core, now);
        }
        let max = if ports.has_links() { 1 } else { BATCH };
        let more = core.pump(now(), max, &mut |to, bytes| {
            if !ports.send(to, bytes) {
                counters.send_failed.hit();
            }
        });
        if !more {
            return;
        }
    }
}

//! All sockets, connections and serial lines of the agent, and one wait for all of them.

use super::arrived::Arrived;
use super::found::Found;
use super::link::{Dead, Link};
use super::peer::Peer;
use super::secure::{DtlsPort, TlsPort};
use super::udp::{Arrival, UdpPort};
use crate::agent_core::{AgentCore, Now};
use crate::config::{AgentConfig, SerialConfig};
use crate::error::AgentError;
use crate::report::Reason;
use replenish_os::tty::Tty;
use replenish_os::{PollFd, WakeFd, poll};
use replenish_xrce::Nanos;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener};

const SECOND: Nanos = 1_000_000_000;

/// The interval between attempts to reopen lost serial lines and to close silent connections.
const UPKEEP: Nanos = SECOND;

/// The time after which a connection without a session is closed, whatever comes on it.
pub(super) const LOG_IN: Nanos = 5 * SECOND;

/// The age from which a connection without a session makes room for a new one.
const VACANT: Nanos = SECOND;

/// Datagrams, connections or pieces taken from one port before the others have their turn.
pub(super) const BATCH: usize = 32;

/// A port that is ready after a wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ready {
    Wake,
    Udp(usize),
    Dtls,
    Listener,
    TlsListener,
    Read(usize),
    Write(usize),
}

/// All ports. Links are numbered: serial lines first, as in the configuration, then connections.
#[derive(Debug)]
pub(super) struct Ports {
    udp: Vec<UdpPort>,
    pub(super) dtls: Option<DtlsPort>,
    pub(super) tls: Option<TlsPort>,
    /// Messages, refusals and ends of an encrypted port; kept for its memory.
    pub(super) found: Found,
    listener: Option<TcpListener>,
    tcp_addr: Option<SocketAddr>,
    /// An `accept` failed; the listener is not polled until the next upkeep.
    pub(super) accept_paused: bool,
    lines: Vec<SerialConfig>,
    pub(super) links: Vec<Option<Link>>,
    /// Messages of the read under way; kept for its memory.
    arrived: Arrived,
    /// Sessions so far when links were held last.
    sessions: u64,
    /// Connections so far.
    pub(super) connections: u64,
    max_links: usize,
    silence: Nanos,
    upkeep_at: Nanos,
}

impl Ports {
    pub(super) fn open(config: &AgentConfig, now: Nanos) -> Result<Self, AgentError> {
        let addresses = std::iter::once(&config.addr).chain(&config.more_udp);
        let addresses = addresses.filter(|_| !config.without_udp);
        let udp = addresses
            .map(|addr| UdpPort::bind(*addr))
            .collect::<Result<_, _>>()?;
        let listen = |addr| {
            let error = |error| AgentError::new("listen at", addr, error);
            let listener = TcpListener::bind(addr).map_err(error)?;
            listener.set_nonblocking(true).map_err(error)?;
            Ok::<_, AgentError>(listener)
        };
        let listener = config.tcp.map(listen).transpose()?;
        let tcp_addr = listener.as_ref().and_then(|l| l.local_addr().ok());
        let mut links = Vec::new();
        for (line, serial) in config.serial.iter().enumerate() {
            let tty = Tty::open(&serial.path, serial.baud);
            let tty = tty.map_err(|source| AgentError::Serial {
                path: serial.path.clone(),
                source,
            })?;
            links.push(Some(Link::serial(tty, line, now)));
        }
        Ok(Self {
            udp,
            dtls: DtlsPort::open(config, now)?,
            tls: TlsPort::open(config)?,
            found: Found::default(),
            listener,
            tcp_addr,
            accept_paused: false,
            max_links: links.len() + config.limits.clients,
            lines: config.serial.clone(),
            links,
            arrived: Arrived::default(),
            sessions: 0,
            connections: 0,
            silence: config.limits.silence,
            upkeep_at: now.saturating_add(UPKEEP),
        })
    }

    /// The UDP addresses that the agent listens at.
    pub(super) fn udp_addrs(&self) -> impl Iterator<Item = SocketAddr> {
        self.udp.iter().map(UdpPort::local_addr)
    }

    pub(super) fn tcp_addr(&self) -> Option<SocketAddr> {
        self.tcp_addr
    }

    /// Whether there is anything but UDP.
    pub(super) fn has_links(&self) -> bool {
        !self.links.is_empty()
    }

    /// Waits until something is ready, or `deadline`; fills `ready`.
    pub(super) fn wait(
        &self,
        wake: &WakeFd,
        deadline: Option<Nanos>,
        ready: &mut Vec<Ready>,
    ) -> std::io::Result<()> {
        let upkeep = (self.has_links() || self.accept_paused).then_some(self.upkeep_at);
        let dtls = self.dtls.as_ref().map(|dtls| {
            let handshake = dtls.next_deadline();
            handshake.map_or(self.upkeep_at, |at| at.min(self.upkeep_at))
        });
        let deadline = deadline.into_iter().chain(upkeep).chain(dtls).min();
        let mut fds = Vec::with_capacity(4 + self.udp.len() + 2 * self.links.len());
        ready.clear();
        fds.push(PollFd::readable(wake));
        ready.push(Ready::Wake);
        for (at, udp) in self.udp.iter().enumerate() {
            fds.push(PollFd::readable(udp));
            ready.push(Ready::Udp(at));
        }
        if let Some(listener) = self.listener.as_ref().filter(|_| !self.accept_paused) {
            fds.push(PollFd::readable(listener));
            ready.push(Ready::Listener);
        }
        if let Some(dtls) = &self.dtls {
            fds.push(PollFd::readable(dtls));
            ready.push(Ready::Dtls);
        }
        if let Some(tls) = self.tls.as_ref().filter(|_| !self.accept_paused) {
            fds.push(PollFd::readable(&tls.listener));
            ready.push(Ready::TlsListener);
        }
        for (at, link) in self.links.iter().enumerate() {
            let Some(link) = link else {
                continue;
            };
            fds.push(PollFd::readable(link));
            ready.push(Ready::Read(at));
            if link.is_busy() {
                fds.push(PollFd::writable(link));
                ready.push(Ready::Write(at));
            }
        }
        poll(&mut fds, deadline)?;
        let mut found = fds.iter().map(PollFd::is_ready);
        ready.retain(|_| found.next().unwrap_or(false));
        Ok(())
    }

    /// Takes waiting UDP datagrams; calls `after` after each.
    pub(super) fn receive_udp(
        &mut self,
        port: usize,
        core: &mut AgentCore<Peer>,
        clock: impl Fn() -> Now,
        mut after: impl FnMut(&mut Self, &mut AgentCore<Peer>),
    ) -> Result<(), AgentError> {
        for _ in 0..BATCH {
            let Some(udp) = self.udp.get_mut(port) else {
                return Ok(());
            };
            match udp.receive()? {
                Arrival::Nothing => return Ok(()),
                Arrival::Ignored => {}
                Arrival::Datagram(addr, bytes) => {
                    core.receive(clock(), Peer::Udp { port, addr }, bytes);
                    after(self, core);
                }
            }
        }
        Ok(())
    }

    /// Takes connections that wait.
    pub(super) fn accept(&mut self, core: &mut AgentCore<Peer>, now: Nanos) {
        for _ in 0..BATCH {
            let (stream, addr) = match self.listener.as_ref().map(TcpListener::accept) {
                Some(Ok(accepted)) => accepted,
                Some(Err(error)) if error.kind() == ErrorKind::WouldBlock => return,
                _ => {
                    // Perhaps there are no descriptors: asking again at once would not help.
                    self.accept_paused = true;
                    return;
                }
            };
            self.connections += 1;
            let link = Link::tcp(stream, self.connections, addr, now);
            self.add(link, addr, core, now);
        }
    }

    /// Gives a connection a place, if there is one.
    pub(super) fn add(
        &mut self,
        link: std::io::Result<Link>,
        addr: SocketAddr,
        core: &mut AgentCore<Peer>,
        now: Nanos,
    ) {
        let lines = self.lines.len();
        if self.links.iter().flatten().count() >= self.max_links {
            self.vacate(core, now);
        }
        let free = self.links.iter().skip(lines).position(Option::is_none);
        let full = free.is_none() && self.links.len() >= self.max_links;
        match (link, free) {
            (Ok(link), Some(at)) => {
                if let Some(slot) = self.links.get_mut(lines + at) {
                    *slot = Some(link);
                }
            }
            (Ok(link), None) if !full => self.links.push(Some(link)),
            _ => {
                core.counters().connections_refused.hit();
                let number = self.connections;
                let limit = self.max_links - self.lines.len();
                let reason = Reason::Connection { limit };
                core.note(Peer::Tcp { number, addr }, None, reason);
            }
        }
    }

    /// Reads a link; calls `after` after each message, so that a burst does not pass through the
    /// queues of its readers as one.
    pub(super) fn read(
        &mut self,
        at: usize,
        core: &mut AgentCore<Peer>,
        clock: impl Fn() -> Now,
        mut after: impl FnMut(&mut Self, &mut AgentCore<Peer>),
    ) {
        let Some(link) = self.links.get_mut(at).and_then(Option::as_mut) else {
            return;
        };
        let mut arrived = std::mem::take(&mut self.arrived);
        let before = link.frames();
        let result = link.receive(clock().monotonic, |from, message| {
            arrived.push(from, message);
        });
        let frames = link.frames();
        let bad = (frames.damaged - before.damaged) + (frames.cut - before.cut);
        let bad = bad + (frames.too_long - before.too_long);
        if bad > 0 {
            core.counters().bad_frames.add(bad);
            core.note(link.peer(), None, Reason::Frames { count: bad });
        }
        for (from, message) in arrived.iter() {
            core.receive(clock(), from, message);
            after(self, core);
        }
        arrived.clear();
        self.arrived = arrived;
        if let Err(Dead) = result {
            self.note_failure(at, false, core);
            self.lose(at, core);
        }
    }

    /// Goes on writing to a link.
    pub(super) fn write(&mut self, at: usize, core: &mut AgentCore<Peer>) {
        let Some(link) = self.links.get_mut(at).and_then(Option::as_mut) else {
            return;
        };
        if let Err(Dead) = link.flush() {
            self.lose(at, core);
        }
    }

    /// Sends a datagram; returns whether it was taken.
    pub(super) fn send(&mut self, to: &Peer, bytes: &[u8]) -> bool {
        if let Peer::Udp { port, addr } = to {
            let udp = self.udp.get(*port);
            return udp.is_some_and(|udp| udp.send(*addr, bytes));
        }
        if let Peer::Dtls { addr, .. } = to {
            return self
                .dtls
                .as_mut()
                .is_some_and(|dtls| dtls.send(*addr, bytes));
        }
        let link = self.links.iter_mut().flatten().find(|l| l.leads_to(to));
        link.is_some_and(|link| link.send(to, bytes))
    }

    /// Holds the clients behind links that have got full, and releases those behind links with
    /// room. A session that was opened since then may be behind a link that is held already.
    pub(super) fn update_held_links(&mut self, core: &mut AgentCore<Peer>, now: impl Fn() -> Now) {
        let sessions = core.sessions_opened();
        let opened = std::mem::replace(&mut self.sessions, sessions) != sessions;
        for link in self.links.iter_mut().flatten() {
            if link.is_busy() {
                if link.held && !opened {
                    continue;
                }
                link.held = true;
                core.hold(|peer| link.leads_to(peer));
            } else if link.held {
                link.held = false;
                core.release(now(), |peer| link.leads_to(peer));
            }
        }
    }

    /// Reopens lost serial lines and closes silent connections.
    pub(super) fn upkeep(&mut self, core: &mut AgentCore<Peer>, now: Nanos) {
        let due = now >= self.upkeep_at;
        self.upkeep_secure(due, core, now);
        if !due {
            return;
        }
        self.accept_paused = false;
        self.upkeep_at = now.saturating_add(UPKEEP);
        for (line, serial) in self.lines.iter().enumerate() {
            if let Some(slot) = self.links.get_mut(line).filter(|slot| slot.is_none()) {
                let tty = Tty::open(&serial.path, serial.baud);
                *slot = tty.ok().map(|tty| Link::serial(tty, line, now));
            }
        }
        for at in self.lines.len()..self.links.len() {
            let Some(link) = self.links.get_mut(at).and_then(Option::as_mut) else {
                continue;
            };
            if core.has_session(|peer| link.leads_to(peer)) {
                link.vacant_since = now;
            }
            let vacant = now.saturating_sub(link.vacant_since) > LOG_IN;
            let silent = now.saturating_sub(link.heard) > self.silence;
            let peer = link.peer();
            if vacant && !self.note_failure(at, true, core) {
                let reason = Reason::NoLogIn { limit: LOG_IN };
                core.note(peer, None, reason);
            }
            if vacant || silent {
                self.lose(at, core);
            }
        }
    }

    /// Closes the oldest connection without a session, if it is old enough, for a new one.
    fn vacate(&mut self, core: &mut AgentCore<Peer>, now: Nanos) {
        let links = self.links.iter().enumerate().skip(self.lines.len());
        let links = links.filter_map(|(at, link)| Some((at, link.as_ref()?)));
        let vacant = links
            .filter(|(_, link)| now.saturating_sub(link.vacant_since) >= VACANT)
            .filter(|(_, link)| !core.has_session(|peer| link.leads_to(peer)))
            .min_by_key(|(_, link)| link.vacant_since)
            .map(|(at, link)| (at, link.peer()));
        if let Some((at, peer)) = vacant {
            core.note(peer, None, Reason::NoLogIn { limit: VACANT });
            self.lose(at, core);
        }
    }

    /// Removes a dead link and ends its sessions.
    pub(super) fn lose(&mut self, at: usize, core: &mut AgentCore<Peer>) {
        if let Some(link) = self.links.get_mut(at).and_then(Option::take) {
            core.gone(|peer| link.leads_to(peer));
        }
        while self.links.len() > self.lines.len() && self.links.last().is_some_and(Option::is_none)
        {
            self.links.pop();
        }
    }
}

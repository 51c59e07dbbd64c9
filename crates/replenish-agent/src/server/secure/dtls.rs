//! The DTLS port: a socket, and an association for each address.

use super::super::found::Found;
use super::super::peer::Peer;
use super::super::udp::{Arrival, UdpPort};
use super::association::{Association, Epoch, Event};
use super::cookie::{self, Cookies};
use super::gate::Gate;
use super::hello::{self, Hello};
use super::identities::Identities;
use crate::config::AgentConfig;
use crate::error::AgentError;
use crate::report::{HandshakeError, Reason};
use dimpl::Config;
use dimpl::crypto::Dtls12CipherSuite;
use replenish_xrce::Nanos;
use replenish_xrce::wire::ClientKey;
use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::time::Duration;

/// The longest message, and the longest datagram of it.
const MESSAGE: usize = 16_000;
const DATAGRAM: usize = 16_384;

/// The longest datagram of a handshake. With a pre-shared key a client's flights have some hundred
/// bytes.
const HANDSHAKE: usize = 2048;

/// Datagrams of a handshake that are kept until an earlier one has come. Their buffers stay in
/// memory as long as the association.
const EARLY: usize = 8;

/// The first repetition of a lost flight comes after this time.
const REPEAT: Duration = Duration::from_millis(250);
const REPETITIONS: usize = 8;

/// Associations beside those of as many clients as there may be: starts that the agent has not
/// forgotten.
const SPARE: usize = 64;

/// Bytes of an association: the records of one datagram, which `dimpl` keeps as eight buffers at
/// most, each of which may once have held the longest; the early datagrams; and keys.
const ASSOCIATION: usize = 8 * DATAGRAM + EARLY * (HANDSHAKE + PARSED);

/// Bytes that `dimpl` needs to describe the records of one datagram: 17 KiB were measured of eight
/// records with eight messages each.
const PARSED: usize = 18 * 1024;

/// The most memory in bytes of the DTLS port of an agent with `clients` clients.
pub(in super::super) fn dtls_bytes(clients: usize) -> usize {
    (clients + SPARE + super::gate::MOST).saturating_mul(ASSOCIATION)
}

/// The type of records that carry messages.
const APPLICATION: u8 = 23;

/// The port.
#[derive(Debug)]
pub(in super::super) struct DtlsPort {
    pub(super) udp: UdpPort,
    config: Arc<Config>,
    pub(super) identities: Arc<Identities>,
    cookies: Cookies,
    gate: Gate,
    epoch: Epoch,
    pub(super) slots: HashMap<SocketAddr, Slot>,
    /// Handshakes under way.
    pub(super) pending: Vec<SocketAddr>,
    pub(super) silence: Nanos,
    /// The most associations that have authenticated.
    most: usize,
    /// The datagram that is looked at, and what is made of it; kept for their memory.
    datagram: Vec<u8>,
    pub(super) buf: Box<[u8]>,
}

/// The associations with one address. The old one lives until the new one has authenticated.
#[derive(Debug, Default)]
pub(super) struct Slot {
    pub(super) live: Option<Live>,
    pub(super) next: Option<Association>,
}

#[derive(Debug)]
pub(super) struct Live {
    pub(super) association: Association,
    pub(super) key: ClientKey,
    pub(super) heard: Nanos,
}

impl DtlsPort {
    /// The port of `config`, if it has one.
    pub(in super::super) fn open(
        config: &AgentConfig,
        now: Nanos,
    ) -> Result<Option<Self>, AgentError> {
        let Some(addr) = config.secure.dtls else {
            return Ok(None);
        };
        let failed = |error: dimpl::Error| {
            AgentError::new("prepare DTLS at", addr, io::Error::other(error.to_string()))
        };
        let identities = Arc::new(Identities::new(config.access.clone().unwrap_or_default()));
        let dtls = Config::builder()
            .with_crypto_provider(cookie::provider())
            .dtls12_cipher_suites(&[Dtls12CipherSuite::PSK_AES128_CCM_8])
            .dtls13_cipher_suites(&[])
            .mtu(DATAGRAM)
            .max_queue_rx(EARLY)
            .flight_start_rto(REPEAT)
            .flight_retries(REPETITIONS)
            .with_psk_server(None, Arc::clone(&identities) as _)
            .build()
            .map_err(failed)?;
        Ok(Some(Self {
            udp: UdpPort::bind(addr)?,
            config: Arc::new(dtls),
            identities,
            cookies: Cookies::new().map_err(failed)?,
            gate: Gate::new(),
            epoch: Epoch::new(now),
            slots: HashMap::new(),
            pending: Vec::new(),
            silence: config.limits.silence,
            most: config.limits.clients + SPARE,
            datagram: Vec::new(),
            buf: vec![0; DATAGRAM + 64].into(),
        }))
    }

    pub(in super::super) fn local_addr(&self) -> SocketAddr {
        self.udp.local_addr()
    }

    /// Time at which a handshake must be looked after.
    pub(in super::super) fn next_deadline(&self) -> Option<Nanos> {
        let next = self
            .pending
            .iter()
            .filter_map(|addr| self.slots.get(addr)?.next.as_ref());
        next.map(|next| next.at.min(next.deadline)).min()
    }

    /// Takes in a datagram if there is one; whether there may be more.
    pub(in super::super) fn receive(
        &mut self,
        now: Nanos,
        found: &mut Found,
    ) -> Result<bool, AgentError> {
        let mut datagram = std::mem::take(&mut self.datagram);
        let addr = match self.udp.receive()? {
            Arrival::Nothing => return Ok(false),
            Arrival::Ignored => return Ok(true),
            Arrival::Datagram(addr, bytes) => {
                datagram.clear();
                datagram.extend_from_slice(bytes);
                addr
            }
        };
        self.take(now, addr, &datagram, found);
        self.datagram = datagram;
        Ok(true)
    }

    fn take(&mut self, now: Nanos, addr: SocketAddr, datagram: &[u8], found: &mut Found) {
        // An association keeps what it is given, so that it is given no more than it needs.
        if datagram.len() > DATAGRAM {
            return;
        }
        let short = datagram.len() <= HANDSHAKE;
        let messages = hello::kind(datagram).is_some_and(|(kind, _)| kind == APPLICATION);
        if Hello::parse(datagram).is_some() {
            if short {
                self.hello(now, addr, datagram, found);
            }
            return;
        }
        match self.slots.get(&addr) {
            Some(Slot { live: Some(_), .. }) if messages => {
                self.take_live(now, addr, datagram, found);
            }
            Some(Slot { next: Some(_), .. }) if short => {
                self.take_next(now, addr, datagram, found);
            }
            Some(_) => self.take_live(now, addr, datagram, found),
            None => {}
        }
    }

    fn take_live(&mut self, now: Nanos, addr: SocketAddr, datagram: &[u8], found: &mut Found) {
        let Self { udp, buf, .. } = self;
        let live = self
            .slots
            .get_mut(&addr)
            .and_then(|slot| slot.live.as_mut());
        let Some(live) = live else {
            return;
        };
        let (peer, mut any) = (
            Peer::Dtls {
                addr,
                key: live.key,
            },
            false,
        );
        let on = &mut |event: Event<'_>| match event {
            Event::Send(datagram) => drop(udp.send(addr, datagram)),
            Event::Message(message) => {
                any = true;
                found.messages.push(peer, message);
            }
        };
        let taken = live
            .association
            .take(now, datagram, &self.identities, (buf, on));
        if any {
            live.heard = now;
        }
        if taken.is_err() || live.association.closed {
            self.end(addr, found);
        }
    }

    fn take_next(&mut self, now: Nanos, addr: SocketAddr, datagram: &[u8], found: &mut Found) {
        let Self { udp, buf, .. } = self;
        let slot = self.slots.get_mut(&addr);
        let Some(next) = slot.and_then(|slot| slot.next.as_mut()) else {
            return;
        };
        let mut early: Vec<Box<[u8]>> = Vec::new();
        let on = &mut |event: Event<'_>| match event {
            Event::Send(datagram) => drop(udp.send(addr, datagram)),
            Event::Message(message) => early.push(message.into()),
        };
        let taken = next.take(now, datagram, &self.identities, (buf, on));
        self.advance(now, addr, taken, found);
        let live = self.slots.get(&addr).and_then(|slot| slot.live.as_ref());
        if let Some(live) = live {
            let peer = Peer::Dtls {
                addr,
                key: live.key,
            };
            early
                .iter()
                .for_each(|message| found.messages.push(peer, message));
        }
    }

    /// A hello begins a handshake if it has the cookie of its address, and gets one otherwise.
    fn hello(&mut self, now: Nanos, addr: SocketAddr, datagram: &[u8], found: &mut Found) {
        let Some(hello) = Hello::parse(datagram) else {
            return;
        };
        let Some(cookie) = self.cookies.cookie(addr, &hello) else {
            return;
        };
        if !cookie::is_same(&cookie, &hello) {
            self.udp.send(addr, &hello::verify_request(&cookie));
            return;
        }
        let next = self.slots.get(&addr).and_then(|slot| slot.next.as_ref());
        match next.map(|next| next.has_begun_with(&hello)) {
            Some(true) => return self.take_next(now, addr, datagram, found),
            // The client has begun anew.
            Some(false) => self.forget_next(addr),
            None => {}
        }
        let others = self.pending.iter().map(SocketAddr::ip);
        let peer = Peer::Udp { port: 0, addr };
        if let Err(reason) = self.gate.admit(now, addr, others) {
            return found.refuse(peer, None, reason);
        }
        let Self { udp, buf, .. } = self;
        let time = (now, self.epoch);
        let begun = Association::begin(&self.config, &hello, cookie, time, buf);
        let on = &mut |event: Event<'_>| {
            if let Event::Send(datagram) = event {
                udp.send(addr, datagram);
            }
        };
        let greeted = begun.and_then(|mut next| {
            next.greet(now, datagram, cookie, &self.identities, (buf, on))?;
            Ok(next)
        });
        match greeted {
            Ok(next) => {
                self.slots.entry(addr).or_default().next = Some(next);
                self.pending.push(addr);
            }
            Err(error) => found.refuse(peer, None, Reason::Handshake(error)),
        }
    }

    /// Drops a handshake without a word.
    fn forget_next(&mut self, addr: SocketAddr) {
        self.pending.retain(|other| *other != addr);
        if let Some(slot) = self.slots.get_mut(&addr) {
            slot.next = None;
            if slot.live.is_none() {
                self.slots.remove(&addr);
            }
        }
    }

    /// A handshake has gone on: it has ended well, or badly, or is under way.
    pub(super) fn advance(
        &mut self,
        now: Nanos,
        addr: SocketAddr,
        taken: Result<(), HandshakeError>,
        found: &mut Found,
    ) {
        let full = self
            .slots
            .values()
            .filter(|slot| slot.live.is_some())
            .count()
            >= self.most;
        let Some(slot) = self.slots.get_mut(&addr) else {
            return;
        };
        let connected = slot.next.as_ref().is_some_and(|next| next.connected);
        if taken.is_ok() && !connected {
            return;
        }
        self.pending.retain(|other| *other != addr);
        let Some(association) = slot.next.take() else {
            return;
        };
        match (taken, association.key) {
            (Ok(()), Some(key)) if full && slot.live.is_none() => {
                self.slots.remove(&addr);
                let limit = self.most;
                found.refuse(
                    Peer::Udp { port: 0, addr },
                    Some(key),
                    Reason::Handshakes { limit },
                );
            }
            (Ok(()), Some(key)) => {
                let before = slot.live.take().map(|live| live.key);
                slot.live = Some(Live {
                    association,
                    key,
                    heard: now,
                });
                // The same client at the same address: its session goes on.
                if let Some(before) = before.filter(|before| *before != key) {
                    found.end(Peer::Dtls { addr, key: before });
                }
                self.crowd_out(addr, key, found);
            }
            (taken, key) => {
                if slot.live.is_none() {
                    self.slots.remove(&addr);
                }
                let error = taken.err().unwrap_or(HandshakeError::Protocol);
                found.refuse(Peer::Udp { port: 0, addr }, key, Reason::Handshake(error));
            }
        }
    }

    /// Sends a message; returns whether it was taken.
    pub(in super::super) fn send(&mut self, to: SocketAddr, message: &[u8]) -> bool {
        let Self { udp, buf, .. } = self;
        let live = self.slots.get_mut(&to).and_then(|slot| slot.live.as_mut());
        let Some(live) = live.filter(|_| message.len() <= MESSAGE) else {
            return false;
        };
        let mut taken = true;
        let on = &mut |event: Event<'_>| {
            if let Event::Send(datagram) = event {
                taken &= udp.send(to, datagram);
            }
        };
        let sent = live.association.send(message, (buf, on));
        sent && taken
    }
}

impl AsFd for DtlsPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.udp.as_fd()
    }
}

//! One DTLS association: a handshake, then records.

use super::cookie;
use super::hello::{COOKIE, Hello};
use super::identities::{Asked, Identities};
use super::{gate, hello};
use crate::report::HandshakeError;
use dimpl::{Config, Dtls, Output};
use replenish_xrce::Nanos;
use replenish_xrce::wire::ClientKey;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Records that an association sends at most. Each takes a random nonce of 64 bits; two are equal
/// after this many with a probability of 2^-17 at most.
const MOST_RECORDS: u64 = 1 << 24;

/// Undecipherable records of a handshake after which the client's key must be another one. Fewer
/// may have overtaken the message that they need.
const UNDECIPHERED: u8 = 3;

const HANDSHAKE: u8 = 22;

/// The clock of `dimpl`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Epoch {
    instant: Instant,
    nanos: Nanos,
}

impl Epoch {
    pub(super) fn new(now: Nanos) -> Self {
        Self {
            instant: Instant::now(),
            nanos: now,
        }
    }

    fn instant(&self, at: Nanos) -> Instant {
        self.instant + Duration::from_nanos(at.saturating_sub(self.nanos))
    }

    fn nanos(&self, at: Instant) -> Nanos {
        let since = at.saturating_duration_since(self.instant);
        let since = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        self.nanos.saturating_add(since)
    }
}

/// Something that an association has for the port.
pub(super) enum Event<'a> {
    /// A datagram to send.
    Send(&'a [u8]),
    /// A message of the client.
    Message(&'a [u8]),
}

/// Memory for what comes out of an association, and the port's way to take it.
pub(super) type Out<'a> = (&'a mut [u8], &'a mut dyn FnMut(Event<'_>));

/// An association with one address.
pub(super) struct Association {
    dtls: Dtls,
    epoch: Epoch,
    /// The random number of the hello that it has begun with.
    random: [u8; 32],
    /// The client that the peer says it is; shown once it is connected.
    pub(super) key: Option<ClientKey>,
    pub(super) connected: bool,
    /// The client has ended it.
    pub(super) closed: bool,
    /// Times at which the handshake must be looked after, and at which it must be over.
    pub(super) at: Nanos,
    pub(super) deadline: Nanos,
    undeciphered: u8,
    sent: u64,
}

impl std::fmt::Debug for Association {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Association")
            .field("key", &self.key)
            .field("connected", &self.connected)
            .finish_non_exhaustive()
    }
}

impl Association {
    /// Begins a handshake after a hello with a checked cookie.
    pub(super) fn begin(
        config: &Arc<Config>,
        hello: &Hello<'_>,
        cookie: [u8; COOKIE],
        (now, epoch): (Nanos, Epoch),
        buf: &mut [u8],
    ) -> Result<Self, HandshakeError> {
        let mut association = Self {
            dtls: Dtls::new_12_psk(Arc::clone(config), epoch.instant(now)),
            epoch,
            random: *hello.random,
            key: None,
            connected: false,
            closed: false,
            at: now,
            deadline: now.saturating_add(gate::DEADLINE),
            undeciphered: 0,
            sent: 0,
        };
        let instant = epoch.instant(now);
        let Association { dtls, .. } = &mut association;
        // The hello asks for a cookie; that has been done.
        let taken = cookie::with_checked(cookie, || {
            dtls.handle_timeout(instant)?;
            dtls.handle_packet(&hello.without_cookie())
        });
        taken.map_err(|_| HandshakeError::Protocol)?;
        while !matches!(dtls.poll_output(buf), Output::Timeout(_)) {}
        Ok(association)
    }

    /// Whether a hello is the one that it has begun with, again.
    pub(super) fn has_begun_with(&self, hello: &Hello<'_>) -> bool {
        self.random == *hello.random
    }

    /// Takes in the hello that it has begun with.
    pub(super) fn greet(
        &mut self,
        now: Nanos,
        hello: &[u8],
        cookie: [u8; COOKIE],
        identities: &Identities,
        (buf, on): Out<'_>,
    ) -> Result<(), HandshakeError> {
        cookie::with_checked(cookie, || self.take(now, hello, identities, (buf, on)))
    }

    /// Takes in a datagram.
    pub(super) fn take(
        &mut self,
        now: Nanos,
        datagram: &[u8],
        identities: &Identities,
        (buf, on): Out<'_>,
    ) -> Result<(), HandshakeError> {
        let instant = self.epoch.instant(now);
        let taken = self.dtls.handle_timeout(instant);
        let taken = taken.and_then(|()| self.dtls.handle_packet(datagram));
        let unknown = match identities.asked() {
            Some(Asked::Known(key)) => {
                self.key = Some(key);
                false
            }
            Some(Asked::Unknown) => true,
            None => false,
        };
        if unknown {
            return Err(HandshakeError::UnknownIdentity);
        }
        if taken.is_err() {
            return Err(self.failure());
        }
        self.drain(buf, on);
        let finished = |record| hello::kind(record).is_some_and(|kind| kind == (HANDSHAKE, 1));
        if !self.connected && self.key.is_some() && hello::records(datagram).any(finished) {
            self.undeciphered += 1;
            if self.undeciphered >= UNDECIPHERED {
                return Err(HandshakeError::WrongKey);
            }
        }
        Ok(())
    }

    /// Repeats what the client seems to have missed.
    pub(super) fn tick(&mut self, now: Nanos, (buf, on): Out<'_>) -> Result<(), HandshakeError> {
        if now >= self.deadline {
            return Err(match self.key {
                Some(_) if self.undeciphered > 0 => HandshakeError::WrongKey,
                _ => HandshakeError::Unfinished {
                    limit: gate::DEADLINE,
                },
            });
        }
        let taken = self.dtls.handle_timeout(self.epoch.instant(now));
        taken.map_err(|_| self.failure())?;
        self.drain(buf, on);
        Ok(())
    }

    /// Encrypts a message. Whether it was sent.
    pub(super) fn send(&mut self, message: &[u8], (buf, on): Out<'_>) -> bool {
        self.sent += 1;
        let sent = self.connected && self.sent <= MOST_RECORDS;
        let sent = sent && self.dtls.send_application_data(message).is_ok();
        if sent {
            self.drain(buf, on);
        }
        self.closed |= self.sent >= MOST_RECORDS;
        sent
    }

    /// Tells the client that it is over.
    pub(super) fn close(&mut self, (buf, on): Out<'_>) {
        if self.dtls.close().is_ok() {
            self.drain(buf, on);
        }
    }

    fn failure(&self) -> HandshakeError {
        if self.key.is_some() && !self.connected {
            HandshakeError::WrongKey
        } else {
            HandshakeError::Protocol
        }
    }

    fn drain(&mut self, buf: &mut [u8], on: &mut dyn FnMut(Event<'_>)) {
        loop {
            match self.dtls.poll_output(buf) {
                Output::Packet(datagram) => on(Event::Send(datagram)),
                Output::ApplicationData(message) => on(Event::Message(message)),
                Output::Connected => self.connected = true,
                Output::CloseNotify => self.closed = true,
                Output::Timeout(at) => {
                    self.at = self.epoch.nanos(at);
                    return;
                }
                // The buffer holds the longest datagram, and there is nothing else without
                // certificates.
                Output::BufferTooSmall { .. } => {
                    self.closed = true;
                    return;
                }
                _ => {}
            }
        }
    }
}

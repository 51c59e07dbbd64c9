//! One DTLS association of a client: a handshake, then records; and the next one when it is over.

use crate::psk::Psk;
use crate::status::Status;
use dimpl::crypto::{Dtls12CipherSuite, rust_crypto};
use dimpl::{Config, Dtls, Output};
use replenish_xrce::udp::{Sent, UdpTransport};
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The longest datagram: of a message of [`MESSAGE`] bytes.
pub(crate) const DATAGRAM: usize = 16_384;

/// The longest message.
pub(crate) const MESSAGE: u16 = 16_000;

/// Records that an association sends before it makes place for the next one. Each takes a random
/// nonce of 64 bits.
const RECORDS: u64 = 1 << 23;

/// The time after which a handshake begins anew.
const HANDSHAKE: Duration = Duration::from_secs(3);

/// The first repetition of a lost flight comes after this time.
const REPEAT: Duration = Duration::from_millis(250);

pub(crate) struct Seal {
    config: Arc<Config>,
    dtls: Dtls,
    connected: bool,
    /// One message waits for the end of the handshake.
    greeted: bool,
    begun: Instant,
    /// The first message since the agent was heard.
    asked: Option<Instant>,
    /// The time after which an agent that does not answer has perhaps forgotten the association.
    forgotten: Duration,
    records: u64,
    closed: bool,
    buf: Box<[u8]>,
    status: Arc<Status>,
}

impl std::fmt::Debug for Seal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Seal")
            .field("connected", &self.connected)
            .finish_non_exhaustive()
    }
}

impl Seal {
    pub(crate) fn new(
        identity: &str,
        psk: &Psk,
        forgotten: Duration,
        status: Arc<Status>,
    ) -> Result<Self, dimpl::Error> {
        let config = Config::builder()
            .with_crypto_provider(rust_crypto::default_provider())
            .dtls12_cipher_suites(&[Dtls12CipherSuite::PSK_AES128_CCM_8])
            .dtls13_cipher_suites(&[])
            .mtu(DATAGRAM)
            .flight_start_rto(REPEAT)
            .flight_retries(8)
            .with_psk_client(identity.as_bytes().to_vec(), Arc::new(psk.clone()))
            .build()?;
        let config = Arc::new(config);
        let now = Instant::now();
        Ok(Self {
            dtls: client(&config, now),
            config,
            connected: false,
            greeted: false,
            begun: now,
            asked: None,
            forgotten,
            records: 0,
            closed: false,
            buf: vec![0; DATAGRAM + 64].into(),
            status,
        })
    }

    fn renew(&mut self, now: Instant) {
        self.dtls = client(&self.config, now);
        self.connected = false;
        self.greeted = false;
        self.begun = now;
        self.asked = None;
        self.records = 0;
    }

    /// Encrypts and sends a message. Before the handshake is over, the first waits for its end and
    /// others are lost.
    pub(crate) fn send(&mut self, message: &[u8], socket: &UdpTransport) -> io::Result<Sent> {
        let now = Instant::now();
        let since = |at: Instant| now.saturating_duration_since(at);
        let over = if self.connected {
            let unheard = self.asked.is_some_and(|at| since(at) > self.forgotten);
            unheard || self.records >= RECORDS
        } else {
            since(self.begun) > HANDSHAKE
        };
        if over {
            self.renew(now);
        }
        if !self.connected {
            self.tick(socket);
            if std::mem::replace(&mut self.greeted, true) {
                return Ok(Sent::Full);
            }
        }
        self.records += 1;
        self.asked = self.asked.or(Some(now));
        if self.dtls.send_application_data(message).is_err() {
            self.renew(now);
            return Ok(Sent::Full);
        }
        self.drain(socket, &mut |_| ())
    }

    /// Takes in a datagram, and calls `on` with each message of it.
    pub(crate) fn take(
        &mut self,
        datagram: &[u8],
        socket: &UdpTransport,
        on: &mut dyn FnMut(&[u8]),
    ) -> io::Result<()> {
        let now = Instant::now();
        if !self.connected {
            self.status.answered();
        }
        let taken = self.dtls.handle_timeout(now);
        let taken = taken.and_then(|()| self.dtls.handle_packet(datagram));
        if let Err(error) = taken {
            self.status.failed(error.to_string());
            self.renew(now);
            return Ok(());
        }
        let mut heard = false;
        let sent = self.drain(socket, &mut |message| {
            heard = true;
            on(message);
        });
        if heard {
            self.asked = None;
        }
        sent.map(drop)
    }

    /// Repeats what was lost of a handshake.
    pub(crate) fn tick(&mut self, socket: &UdpTransport) {
        if self.connected || !self.greeted {
            return;
        }
        let now = Instant::now();
        let lost = self.dtls.handle_timeout(now).is_err();
        if lost || self.drain(socket, &mut |_| ()).is_err() {
            self.renew(now);
        }
    }

    /// Whether the agent has ended the association since the last call.
    pub(crate) fn is_closed(&mut self) -> bool {
        let closed = std::mem::take(&mut self.closed);
        if closed {
            self.renew(Instant::now());
        }
        closed
    }

    /// Tells the agent that it is over.
    pub(crate) fn close(&mut self, socket: &UdpTransport) {
        if self.dtls.close().is_ok() {
            self.drain(socket, &mut |_| ()).ok();
        }
    }

    fn drain(&mut self, socket: &UdpTransport, on: &mut dyn FnMut(&[u8])) -> io::Result<Sent> {
        let mut fate = Sent::Yes;
        loop {
            match self.dtls.poll_output(&mut self.buf) {
                Output::Packet(datagram) => fate = socket.send(datagram)?,
                Output::ApplicationData(message) => on(message),
                Output::Connected => {
                    self.connected = true;
                    self.status.connected();
                }
                Output::CloseNotify => self.closed = true,
                Output::Timeout(_) | Output::BufferTooSmall { .. } => return Ok(fate),
                _ => {}
            }
        }
    }
}

fn client(config: &Arc<Config>, now: Instant) -> Dtls {
    let mut dtls = Dtls::new_12_psk(Arc::clone(config), now);
    dtls.set_active(true);
    dtls
}

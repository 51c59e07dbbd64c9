//! A DTLS client that is nothing but `dimpl`, as any other client of that library.

use dimpl::crypto::Dtls12CipherSuite;
use dimpl::{Config, Dtls, Output, PskResolver};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

struct Key(Vec<u8>);

impl PskResolver for Key {
    fn resolve(&self, _: &[u8]) -> Option<Vec<u8>> {
        Some(self.0.clone())
    }
}

pub(crate) struct Raw {
    pub(crate) socket: UdpSocket,
    dtls: Dtls,
    pub(crate) connected: bool,
    pub(crate) messages: Vec<Vec<u8>>,
    /// Datagrams so far.
    pub(crate) sent: usize,
    buf: Vec<u8>,
}

impl Raw {
    pub(crate) fn new(from: &str, agent: SocketAddr, identity: &str, key: &[u8]) -> Self {
        let config = Config::builder()
            .dtls12_cipher_suites(&[Dtls12CipherSuite::PSK_AES128_CCM_8])
            .dtls13_cipher_suites(&[])
            .mtu(16_384)
            .flight_start_rto(Duration::from_millis(250))
            .with_psk_client(identity.as_bytes().to_vec(), Arc::new(Key(key.to_vec())))
            .build()
            .unwrap();
        let socket = UdpSocket::bind((from, 0)).unwrap();
        socket.connect(agent).unwrap();
        socket
            .set_read_timeout(Some(Duration::from_millis(10)))
            .unwrap();
        let mut dtls = Dtls::new_12_psk(Arc::new(config), Instant::now());
        dtls.set_active(true);
        dtls.handle_timeout(Instant::now()).unwrap();
        Self {
            socket,
            dtls,
            connected: false,
            messages: Vec::new(),
            sent: 0,
            buf: vec![0; 20_000],
        }
    }

    /// Sends what there is to send; the datagrams.
    pub(crate) fn drain(&mut self) -> Vec<Vec<u8>> {
        let mut sent = Vec::new();
        loop {
            match self.dtls.poll_output(&mut self.buf) {
                Output::Packet(datagram) => {
                    self.socket.send(datagram).unwrap();
                    self.sent += 1;
                    sent.push(datagram.to_vec());
                }
                Output::ApplicationData(message) => self.messages.push(message.to_vec()),
                Output::Connected => self.connected = true,
                Output::Timeout(_) => return sent,
                _ => {}
            }
        }
    }

    /// Goes on for so long, or until `done`.
    pub(crate) fn run(&mut self, time: Duration, done: impl Fn(&Self) -> bool) {
        let end = Instant::now() + time;
        let mut buf = vec![0; 20_000];
        while Instant::now() < end && !done(self) {
            if self.dtls.handle_timeout(Instant::now()).is_err() {
                return;
            }
            self.drain();
            if let Ok(len) = self.socket.recv(&mut buf) {
                self.dtls.handle_packet(&buf[..len]).ok();
                self.drain();
            }
        }
    }

    pub(crate) fn send(&mut self, message: &[u8]) {
        self.dtls.send_application_data(message).unwrap();
        self.drain();
    }
}

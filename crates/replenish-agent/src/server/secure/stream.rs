//! One TLS connection as a byte stream that never waits.

use super::certificates::{Listed, fingerprint};
use super::gate;
use crate::report::HandshakeError;
use replenish_xrce::wire::ClientKey;
use rustls::{ServerConfig, ServerConnection};
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;

/// Bytes that wait in the connection, encrypted or not.
const BUFFERED: usize = 64 * 1024;

/// Bytes of a connection beside those of a plain one: what waits in both directions, records that
/// are put together, and keys.
pub(in super::super) const TLS_BYTES: usize = 4 * BUFFERED;

/// A connection.
#[derive(Debug)]
pub(in super::super) struct TlsStream {
    tcp: TcpStream,
    tls: ServerConnection,
    listed: Arc<Listed>,
    /// The certificate that it has shown, and the client whose it is.
    shown: Option<([u8; 32], ClientKey)>,
    failed: Option<HandshakeError>,
    closed: bool,
}

impl TlsStream {
    pub(super) fn new(
        tcp: TcpStream,
        config: Arc<ServerConfig>,
        listed: Arc<Listed>,
    ) -> io::Result<Self> {
        let mut tls = ServerConnection::new(config).map_err(io::Error::other)?;
        tls.set_buffer_limit(Some(BUFFERED));
        Ok(Self {
            tcp,
            tls,
            listed,
            shown: None,
            failed: None,
            closed: false,
        })
    }

    pub(in super::super) fn tcp(&self) -> &TcpStream {
        &self.tcp
    }

    /// The client that it has shown to be.
    pub(in super::super) fn identity(&self) -> Option<ClientKey> {
        self.shown.map(|(_, key)| key)
    }

    /// Whether the list still has its certificate, as that of the same client.
    pub(in super::super) fn is_listed(&self) -> bool {
        self.shown
            .is_none_or(|(print, key)| self.listed.owner(&print) == Some(key))
    }

    /// The reason why the connection failed, if it did so before it had shown who it is.
    pub(in super::super) fn failure(&self, late: bool) -> Option<HandshakeError> {
        let limit = gate::DEADLINE;
        let late = late.then_some(HandshakeError::Unfinished { limit });
        let error = self.failed.or(late).unwrap_or(HandshakeError::Protocol);
        self.shown.is_none().then_some(error)
    }

    /// Whether there is something to write.
    pub(in super::super) fn wants_write(&self) -> bool {
        self.tls.wants_write()
    }

    /// Reads once from the socket, and calls `take` with the client and its bytes in the clear.
    pub(in super::super) fn read(
        &mut self,
        take: &mut dyn FnMut(ClientKey, &[u8]),
    ) -> io::Result<()> {
        match self.tls.read_tls(&mut self.tcp) {
            Ok(0) => self.closed = true,
            Ok(_) => {}
            Err(error) => return Err(error),
        }
        let processed = self.tls.process_new_packets();
        if let Err(error) = &processed {
            self.failed = Some(self.listed.failure(error));
        }
        // The answer, or the alert that says why there is none.
        let flushed = self.flush();
        if processed.is_err() || flushed.is_err() {
            return Err(ErrorKind::ConnectionAborted.into());
        }
        if self.shown.is_none() && !self.tls.is_handshaking() {
            let certificates = self.tls.peer_certificates();
            let print = certificates
                .and_then(|chain| chain.first())
                .map(fingerprint);
            let shown = print.and_then(|print| Some((print, self.listed.owner(&print)?)));
            if shown.is_none() {
                self.failed = Some(HandshakeError::NoCertificate);
                return Err(ErrorKind::PermissionDenied.into());
            }
            self.shown = shown;
        }
        let Some((_, key)) = self.shown else {
            let closed = ErrorKind::ConnectionReset.into();
            return if self.closed { Err(closed) } else { Ok(()) };
        };
        let mut piece = [0; 4096];
        loop {
            match self.tls.reader().read(&mut piece) {
                Ok(0) => self.closed = true,
                Ok(len) => {
                    take(key, piece.get(..len).unwrap_or_default());
                    continue;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => return Err(error),
            }
            let closed = ErrorKind::ConnectionReset.into();
            return if self.closed { Err(closed) } else { Ok(()) };
        }
    }

    /// Takes bytes to encrypt and write; how many, as far as there is room.
    pub(in super::super) fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.flush()?;
        let taken = self.tls.writer().write(bytes)?;
        self.flush()?;
        if taken == 0 && !bytes.is_empty() {
            return Err(ErrorKind::WouldBlock.into());
        }
        Ok(taken)
    }

    /// Writes what is encrypted, as far as there is room.
    pub(in super::super) fn flush(&mut self) -> io::Result<()> {
        while self.tls.wants_write() {
            match self.tls.write_tls(&mut self.tcp) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

impl AsFd for TlsStream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.tcp.as_fd()
    }
}

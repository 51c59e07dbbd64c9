//! Stand-ins for encrypted ports: the feature `secure` is off. As in `secure/`, with values that
//! cannot exist.

use super::found::Found;
use super::peer::Peer;
use crate::config::{AccessList, AgentConfig};
use crate::error::AgentError;
use crate::report::{HandshakeError, Reason};
use replenish_xrce::Nanos;
use replenish_xrce::wire::ClientKey;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};

#[derive(Debug)]
pub(super) enum DtlsPort {}

impl DtlsPort {
    #[expect(clippy::unnecessary_wraps, reason = "as with the feature")]
    pub(super) fn open(_: &AgentConfig, _: Nanos) -> Result<Option<Self>, AgentError> {
        Ok(None)
    }

    pub(super) fn local_addr(&self) -> SocketAddr {
        match *self {}
    }

    pub(super) fn next_deadline(&self) -> Option<Nanos> {
        match *self {}
    }

    pub(super) fn receive(&mut self, _: Nanos, _: &mut Found) -> Result<bool, AgentError> {
        match *self {}
    }

    pub(super) fn send(&mut self, _: SocketAddr, _: &[u8]) -> bool {
        match *self {}
    }

    pub(super) fn tick(&mut self, _: Nanos, _: &mut Found) {
        match *self {}
    }

    pub(super) fn upkeep(&mut self, _: Nanos, _: Nanos, _: impl Fn(&Peer) -> bool, _: &mut Found) {
        match *self {}
    }

    pub(super) fn set_access(&mut self, _: &AccessList, _: &mut Found) {
        match *self {}
    }
}

impl AsFd for DtlsPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match *self {}
    }
}

#[derive(Debug)]
pub(super) struct TlsPort {
    pub(super) listener: TcpListener,
    never: Never,
}

#[derive(Debug)]
enum Never {}

impl TlsPort {
    #[expect(clippy::unnecessary_wraps, reason = "as with the feature")]
    pub(super) fn open(_: &AgentConfig) -> Result<Option<Self>, AgentError> {
        Ok(None)
    }

    pub(super) fn local_addr(&self) -> SocketAddr {
        match self.never {}
    }

    pub(super) fn fingerprint(&self) -> [u8; 32] {
        match self.never {}
    }

    pub(super) fn accept(
        &mut self,
        _: Nanos,
        _: (TcpStream, SocketAddr),
        _: impl Iterator<Item = IpAddr>,
    ) -> Result<TlsStream, Reason> {
        match self.never {}
    }

    pub(super) fn set_access(&mut self, _: &AccessList) {
        match self.never {}
    }
}

#[derive(Debug)]
pub(super) enum TlsStream {}

impl TlsStream {
    pub(super) fn tcp(&self) -> &TcpStream {
        match *self {}
    }

    pub(super) fn identity(&self) -> Option<ClientKey> {
        match *self {}
    }

    pub(super) fn is_listed(&self) -> bool {
        match *self {}
    }

    pub(super) fn failure(&self, _: bool) -> Option<HandshakeError> {
        match *self {}
    }

    pub(super) fn wants_write(&self) -> bool {
        match *self {}
    }

    pub(super) fn read(&mut self, _: &mut dyn FnMut(ClientKey, &[u8])) -> io::Result<()> {
        match *self {}
    }

    pub(super) fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        match *self {}
    }

    pub(super) fn flush(&mut self) -> io::Result<()> {
        match *self {}
    }
}

impl AsFd for TlsStream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match *self {}
    }
}

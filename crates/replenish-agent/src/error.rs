//! Why an agent cannot start or go on.

use std::fmt;
use std::io;
use std::net::SocketAddr;

/// An agent could not be started, or its socket failed.
#[derive(Debug)]
#[non_exhaustive]
pub enum AgentError {
    /// Something else listens there.
    AddressInUse(SocketAddr),
    /// The operating system refused.
    Io {
        /// What was tried.
        what: &'static str,
        /// The address it was tried with.
        addr: SocketAddr,
        /// Its reason.
        source: io::Error,
    },
}

impl AgentError {
    pub(crate) fn new(what: &'static str, addr: SocketAddr, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::AddrInUse => Self::AddressInUse(addr),
            _ => Self::Io { what, addr, source },
        }
    }
}

impl fmt::Display for AgentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AddressInUse(addr) => {
                write!(
                    f,
                    "address {addr} is in use; another agent may be running there"
                )
            }
            Self::Io { what, addr, source } => write!(f, "cannot {what} {addr}: {source}"),
        }
    }
}

impl std::error::Error for AgentError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::AddressInUse(_) => None,
            Self::Io { source, .. } => Some(source),
        }
    }
}

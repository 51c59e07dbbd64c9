//! Reasons why an agent cannot start or go on.

use replenish_os::config::ConfigError;
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

/// An agent could not be started, or its socket failed.
#[derive(Debug)]
#[non_exhaustive]
pub enum AgentError {
    /// A setting is out of its range.
    Config(ConfigError),
    /// Something else listens there.
    AddressInUse(SocketAddr),
    /// A serial line cannot be opened.
    Serial {
        /// The terminal.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// DDS could not be started.
    Dds(crate::dds::DdsError),
    /// A certificate or a private key cannot be used.
    Credentials {
        /// Its file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The operating system refused.
    Io {
        /// The operation.
        what: &'static str,
        /// Its address.
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
            Self::Config(error) => error.fmt(f),
            Self::AddressInUse(addr) => {
                write!(
                    f,
                    "address {addr} is in use; another agent may be running there"
                )
            }
            Self::Serial { path, source } => {
                write!(f, "cannot open serial line {}: {source}", path.display())
            }
            Self::Dds(error) => error.fmt(f),
            Self::Credentials { path, reason } => {
                write!(f, "cannot use {}: {reason}", path.display())
            }
            Self::Io { what, addr, source } => write!(f, "cannot {what} {addr}: {source}"),
        }
    }
}

impl std::error::Error for AgentError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Config(error) => Some(error),
            Self::AddressInUse(_) | Self::Credentials { .. } => None,
            Self::Dds(error) => Some(error),
            Self::Serial { source, .. } | Self::Io { source, .. } => Some(source),
        }
    }
}

impl From<crate::dds::DdsError> for AgentError {
    fn from(error: crate::dds::DdsError) -> Self {
        Self::Dds(error)
    }
}

impl From<ConfigError> for AgentError {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

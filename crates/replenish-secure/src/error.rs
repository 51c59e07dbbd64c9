//! Reasons why there is no encrypted session.

use replenish::Error;
use replenish::middleware::xrce::ConnectError;
use std::fmt;
use std::path::PathBuf;

/// An encrypted session could not be had.
#[derive(Debug)]
#[non_exhaustive]
pub enum SecureError {
    /// A setting is outside its range.
    Setting {
        /// Name of the setting.
        field: &'static str,
        /// The allowed range.
        allowed: &'static str,
    },
    /// A certificate or a private key cannot be used.
    Credentials {
        /// Its file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The agent answered, and there was no agreement: another key, or another certificate.
    Refused {
        /// Its address.
        agent: String,
        /// The cause of the handshake's failure.
        reason: String,
    },
    /// Everything else, as without encryption.
    Connect(ConnectError),
}

impl fmt::Display for SecureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setting { field, allowed } => write!(f, "the setting {field} must be {allowed}"),
            Self::Credentials { path, reason } => {
                write!(f, "cannot use {}: {reason}", path.display())
            }
            Self::Refused { agent, reason } => {
                write!(f, "no handshake with the agent at {agent}: {reason}")
            }
            Self::Connect(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for SecureError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Connect(error) => Some(error),
            _ => None,
        }
    }
}

impl From<ConnectError> for SecureError {
    fn from(error: ConnectError) -> Self {
        Self::Connect(error)
    }
}

impl From<SecureError> for Error {
    fn from(error: SecureError) -> Self {
        let reason = error.to_string();
        Self::Connect { reason }
    }
}

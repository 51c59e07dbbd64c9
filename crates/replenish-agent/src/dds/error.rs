//! Why DDS cannot start, or an endpoint cannot be opened.

use super::config::MAX_DOMAIN;
use replenish_os::config::ConfigError;
use std::fmt;
use std::io;
use std::net::IpAddr;

/// DDS could not be started.
#[derive(Debug)]
#[non_exhaustive]
pub enum DdsError {
    /// A setting is out of its range.
    Config(ConfigError),
    /// No network interface of this machine has the address.
    Interface(IpAddr),
    /// The address is one of IPv6, which the bridge does not speak.
    Ipv6(IpAddr),
    /// The operating system refused.
    Io {
        /// The operation.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
}

impl fmt::Display for DdsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(error) => error.fmt(f),
            Self::Interface(address) => {
                write!(
                    f,
                    "no network interface of this machine has the address {address}"
                )
            }
            Self::Ipv6(address) => write!(
                f,
                "dds.interfaces (--interface) has {address}, an address of IPv6: the bridge speaks \
                 IPv4; give an IPv4 address of this machine, or all"
            ),
            Self::Io { what, source } => write!(f, "cannot {what}: {source}"),
        }
    }
}

impl std::error::Error for DdsError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Config(error) => Some(error),
            Self::Interface(_) | Self::Ipv6(_) => None,
            Self::Io { source, .. } => Some(source),
        }
    }
}

impl From<ConfigError> for DdsError {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

/// An endpoint or node could not be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum OpenError {
    /// There are as many as [`DdsLimits::endpoints`](super::DdsLimits::endpoints) already.
    Full,
    /// Something with this id exists.
    Exists,
    /// The domain is above [`MAX_DOMAIN`](super::MAX_DOMAIN).
    Domain(u16),
    /// The thread of DDS has ended.
    Ended,
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full => f.write_str("there are too many endpoints in DDS"),
            Self::Exists => f.write_str("an endpoint with this id exists"),
            Self::Domain(domain) => {
                write!(f, "the domain is {domain}, allowed is 0 to {MAX_DOMAIN}")
            }
            Self::Ended => f.write_str("the thread of DDS has ended"),
        }
    }
}

impl std::error::Error for OpenError {}

//! The configuration of an agent: its addresses and lines, limits, rules and profiles.

use super::access::AccessList;
use super::limits::Limits;
use super::profiles::Profiles;
use super::rules::TopicRule;
#[cfg(feature = "secure")]
use super::secure::SecureConfig;
use replenish_os::config::{ConfigError, within};
use replenish_os::tty;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

/// Settings of an [`Agent`](crate::Agent).
#[derive(Clone, Debug)]
pub struct AgentConfig {
    /// The first UDP address to listen at. Port 0 lets the operating system choose one.
    ///
    /// Loopback by default: XRCE has no authentication, so that any host that reaches
    /// this address can read and write every topic, as far as `access` allows.
    pub addr: SocketAddr,
    /// Further UDP addresses to listen at; at most 15.
    pub more_udp: Vec<SocketAddr>,
    /// Do not listen for UDP at all; `addr` and `more_udp` do not matter then.
    pub without_udp: bool,
    /// The TCP address to listen at, if any.
    pub tcp: Option<SocketAddr>,
    /// Serial lines to serve; at most 64.
    pub serial: Vec<SerialConfig>,
    /// Bounds on what clients can make the agent hold.
    pub limits: Limits,
    /// The clients that may log in; all without a list.
    pub access: Option<AccessList>,
    /// Rules that make some topics more urgent than others; at most 256.
    pub rules: Vec<TopicRule>,
    /// The meaning of the names that describe entities by reference.
    pub profiles: Profiles,
    /// Ports for clients that encrypt and authenticate.
    #[cfg(feature = "secure")]
    pub secure: SecureConfig,
    /// Makes the clients' topics and services those of DDS, too, so that ROS 2 sees them.
    pub dds: Option<DdsBridge>,
}

/// Settings of the bridge: the form in which clients appear in DDS.
#[derive(Clone, Debug, Default)]
pub struct DdsBridge {
    /// Interfaces, service mapping and limits; loopback by default.
    pub dds: crate::dds::DdsConfig,
    /// The DDS domain of clients that say 0, which microcontrollers usually do: 0 to 232. Others
    /// have the domain they say.
    pub domain: u16,
}

/// A serial line, 8N1 without flow control, with eProsima's framing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialConfig {
    /// The terminal: `/dev/ttyUSB0`, or the other end of a pseudo-terminal.
    pub path: PathBuf,
    /// The speed of the line: one of [`replenish_os::tty::baud_rates`].
    pub baud: u32,
}

impl SerialConfig {
    /// A line at 115 200 baud.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            baud: 115_200,
        }
    }

    fn validate(&self) -> Result<(), ConfigError> {
        if tty::baud_rates().any(|baud| baud == self.baud) {
            return Ok(());
        }
        let rates: Vec<String> = tty::baud_rates().map(|baud| baud.to_string()).collect();
        Err(ConfigError {
            field: "serial.baud",
            value: self.baud.to_string(),
            allowed: rates.join(", "),
        })
    }
}

impl AgentConfig {
    /// Checks all ranges.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.limits.validate()?;
        within("more_udp.length", self.more_udp.len(), 0..=15)?;
        within("serial.length", self.serial.len(), 0..=64)?;
        self.serial.iter().try_for_each(SerialConfig::validate)?;
        within("rules.length", self.rules.len(), 0..=256)?;
        #[cfg(feature = "secure")]
        if self.secure.is_on() && self.access.is_none() {
            return Err(ConfigError {
                field: "secure",
                value: "on".to_owned(),
                allowed: "only with an access list, which has the clients' keys".to_owned(),
            });
        }
        if let Some(bridge) = &self.dds {
            within("dds.domain", bridge.domain, 0..=crate::dds::MAX_DOMAIN)?;
        }
        self.rules.iter().try_for_each(TopicRule::validate)
    }
}

impl Default for AgentConfig {
    /// `127.0.0.1:8888`, the port that stock agents use.
    fn default() -> Self {
        Self {
            addr: (Ipv4Addr::LOCALHOST, 8888).into(),
            more_udp: Vec::new(),
            without_udp: false,
            tcp: None,
            serial: Vec::new(),
            limits: Limits::default(),
            access: None,
            rules: Vec::new(),
            profiles: Profiles::default(),
            #[cfg(feature = "secure")]
            secure: SecureConfig::default(),
            dds: None,
        }
    }
}

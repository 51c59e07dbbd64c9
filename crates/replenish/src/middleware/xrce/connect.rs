//! Connecting over the transports that come with the standard library.

use super::adapter::Xrce;
use super::config::{ConnectError, XrceConfig};
use super::transport::{SerialTransport, TcpTransport, Udp};
use crate::context::Context;
use alloc::string::ToString;
use replenish_xrce::udp::UdpTransport;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::Path;

impl Xrce {
    /// Connects over UDP to the agent at `agent`, an address and port, with the default settings.
    ///
    /// # Errors
    /// [`ConnectError`]; after 1.5 s if nobody answers.
    pub fn udp(agent: &str) -> Result<Self, ConnectError> {
        Self::udp_with(agent, XrceConfig::default())
    }

    /// Connects over UDP to the agent at `agent`, an address and port.
    ///
    /// # Errors
    /// [`ConnectError`]; after [`XrceConfig::connect_timeout`] if nobody answers.
    pub fn udp_with(agent: &str, config: XrceConfig) -> Result<Self, ConnectError> {
        config.check()?;
        let socket = UdpTransport::connect(resolve(agent)?).map_err(address(agent))?;
        Self::over(agent, Udp::new(socket, config.mtu), config)
    }

    /// Connects over TCP to the agent at `agent`, an address and port.
    ///
    /// # Errors
    /// [`ConnectError`]; after [`XrceConfig::connect_timeout`] if nobody answers.
    pub fn tcp_with(agent: &str, config: XrceConfig) -> Result<Self, ConnectError> {
        config.check()?;
        let transport = TcpTransport::new(resolve(agent)?, config.mtu);
        Self::over(agent, transport, config)
    }

    /// Connects over the serial line or pseudo-terminal at `path`, at `baud` bits per second.
    ///
    /// # Errors
    /// [`ConnectError`]; after [`XrceConfig::connect_timeout`] if nobody answers.
    pub fn serial_with(path: &Path, baud: u32, config: XrceConfig) -> Result<Self, ConnectError> {
        config.check()?;
        let agent = path.display().to_string();
        let transport = SerialTransport::open(path, baud, config.mtu).map_err(address(&agent))?;
        Self::over(&agent, transport, config)
    }
}

impl Context {
    /// A context over DDS-XRCE: a session with the agent at `agent`, an address and UDP port.
    ///
    /// [`Xrce::udp_with`] and
    /// [`Context::new`] take other settings than the default ones.
    ///
    /// # Errors
    /// If the address cannot be used, or no agent answers there within 1.5 s.
    pub fn xrce_udp(agent: &str) -> Result<Self, ConnectError> {
        Xrce::udp(agent).map(Self::new)
    }

    /// A context over DDS-XRCE and TCP: a session with the agent at `agent`, an address and port.
    ///
    /// # Errors
    /// If the address cannot be used, or no agent answers there within 1.5 s.
    pub fn xrce_tcp(agent: &str) -> Result<Self, ConnectError> {
        Xrce::tcp_with(agent, XrceConfig::default()).map(Self::new)
    }

    /// A context over DDS-XRCE and a serial line or pseudo-terminal, with the stock framing.
    ///
    /// # Errors
    /// If the line cannot be used, or no agent answers there within 1.5 s.
    pub fn xrce_serial(path: impl AsRef<Path>, baud: u32) -> Result<Self, ConnectError> {
        Xrce::serial_with(path.as_ref(), baud, XrceConfig::slow_line()).map(Self::new)
    }
}

fn address(agent: &str) -> impl Fn(io::Error) -> ConnectError {
    move |source| ConnectError::Address {
        agent: agent.into(),
        source,
    }
}

fn resolve(agent: &str) -> Result<SocketAddr, ConnectError> {
    let mut resolved = agent.to_socket_addrs().map_err(address(agent))?;
    let none = || address(agent)(io::Error::from(ErrorKind::NotFound));
    resolved.next().ok_or_else(none)
}

//! Connecting over the transports that come with the standard library.

use super::adapter::Xrce;
use super::config::{ConnectError, XrceConfig};
use super::transport::{SerialTransport, TcpTransport, Udp};
use crate::context::Context;
use crate::error::Error;
use alloc::format;
use alloc::string::ToString;
use replenish_args::RosArgs;
use replenish_xrce::ping_agent;
use replenish_xrce::udp::UdpTransport;
use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::path::Path;
use std::time::Duration;

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

    /// Asks over UDP whether there is an agent at `agent`, an address and port.
    ///
    /// There is no session for it. It asks up to `attempts` times, each with this much `patience`
    /// for the answer, and gives the round trip, `None` if nobody answers.
    ///
    /// # Errors
    /// [`ConnectError`] for an address that cannot be resolved or used.
    pub fn ping_udp(
        agent: &str,
        patience: Duration,
        attempts: u32,
    ) -> Result<Option<Duration>, ConnectError> {
        ping_agent(resolve(agent)?, patience, attempts).map_err(address(agent))
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

/// The variable that names the agent.
const AGENT: &str = "REPLENISH_AGENT";

impl Context {
    /// The context of a ROS 2 program: its arguments behind `--ros-args` give names and parameters
    /// ([`with_args`](Self::with_args)), SIGINT and SIGTERM end its executors
    /// ([`stop_on_signals`](Self::stop_on_signals)), and the variable `REPLENISH_AGENT` says where
    /// it connects: to the agent at `udp://HOST:PORT`, `tcp://HOST:PORT` or `serial://PATH@BAUD`;
    /// with `ros2` to ROS 2 itself, as [`ros2`](Self::ros2) does; with `in-process` to nobody. It
    /// is `udp://127.0.0.1:8888` if it is not set. `ROS_DOMAIN_ID` is the DDS domain.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), replenish::Error> {
    /// let ctx = replenish::Context::from_args()?;
    /// let node = ctx.node("talker")?; // another one with `--ros-args -r __node:=other`
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::Arguments`] for an argument or variable that cannot be used,
    /// [`Error::Connect`] if no agent answers, or ROS 2 cannot be joined.
    pub fn from_args() -> Result<Self, Error> {
        let args = RosArgs::from_env()?;
        let agent = std::env::var(AGENT).ok().filter(|agent| !agent.is_empty());
        let agent = agent.as_deref().unwrap_or("udp://127.0.0.1:8888");
        let domain = args.environment().domain.unwrap_or(0);
        let context = Self::at(agent, domain)?;
        context.stop_on_signals()?;
        Ok(context.with_args(args))
    }

    fn at(agent: &str, domain: u8) -> Result<Self, Error> {
        let config = |usual| XrceConfig {
            domain: domain.into(),
            ..usual
        };
        let wrong = || Error::Arguments {
            reason: format!(
                "{AGENT}, {agent}: allowed is udp://HOST:PORT, tcp://HOST:PORT, \
                 serial://PATH@BAUD, ros2 or in-process"
            ),
        };
        match agent {
            "in-process" => return Ok(Self::in_process()),
            "ros2" => return Ok(Self::ros2()?),
            _ => {}
        }
        let (transport, place) = agent.split_once("://").ok_or_else(wrong)?;
        let xrce = match transport {
            "udp" => Xrce::udp_with(place, config(XrceConfig::default())),
            "tcp" => Xrce::tcp_with(place, config(XrceConfig::default())),
            "serial" => {
                let (path, baud) = place.rsplit_once('@').ok_or_else(wrong)?;
                let baud = baud.parse().map_err(|_| wrong())?;
                Xrce::serial_with(Path::new(path), baud, config(XrceConfig::slow_line()))
            }
            _ => return Err(wrong()),
        };
        Ok(Self::new(xrce?))
    }
}

fn address(agent: &str) -> impl Fn(io::Error) -> ConnectError {
    move |source| ConnectError::Address {
        agent: agent.into(),
        source,
    }
}

/// The port of an agent whose address names none: that of stock agents.
const PORT: u16 = 8888;

fn resolve(agent: &str) -> Result<SocketAddr, ConnectError> {
    if let Ok(host) = agent.parse::<IpAddr>() {
        return Ok((host, PORT).into());
    }
    let explained = |e: io::Error| match e.kind() {
        ErrorKind::InvalidInput => io::Error::new(
            ErrorKind::InvalidInput,
            format!("{e}: allowed is an IP address or a host, and a port, as 192.168.7.1:{PORT}"),
        ),
        _ => e,
    };
    let resolved = agent.to_socket_addrs().map_err(explained);
    let mut resolved = resolved.map_err(address(agent))?;
    let none = || address(agent)(io::Error::from(ErrorKind::NotFound));
    resolved.next().ok_or_else(none)
}

//! Connecting to an agent over DTLS and TLS.

use crate::certificates::TlsCredentials;
use crate::dtls::DtlsTransport;
use crate::error::SecureError;
use crate::psk::Psk;
use crate::seal::{MESSAGE, Seal};
use crate::status::Status;
use crate::tls::TlsTransport;
use replenish::middleware::xrce::{ConnectError, Transport, Xrce, XrceConfig};
use replenish_xrce::udp::UdpTransport;
use replenish_xrce::wire::ClientKey;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, ToSocketAddrs};
use std::sync::Arc;
use std::time::Duration;

/// Connects over UDP with DTLS to the agent at `agent`, an address and port. [`XrceConfig::key`]
/// must be set: under its eight hexadecimal digits the agent's access list has the pre-shared key.
///
/// # Errors
/// [`SecureError`]; after [`XrceConfig::connect_timeout`] if no agent answers, or if the agent does
/// not have this key for this client.
pub fn connect_dtls(agent: &str, psk: &Psk, config: XrceConfig) -> Result<Xrce, SecureError> {
    let key = key(&config)?;
    if config.mtu > MESSAGE {
        let allowed = "up to 16000 bytes over DTLS";
        return Err(SecureError::Setting {
            field: "mtu",
            allowed,
        });
    }
    let socket = UdpTransport::connect(resolve(agent)?).map_err(address(agent))?;
    let status = Arc::new(Status::default());
    let forgotten = Duration::from_nanos(config.ping.silence_limit) + Duration::from_millis(100);
    let seal = Seal::new(&key.to_string(), psk, forgotten, Arc::clone(&status));
    let seal = seal.map_err(|why| SecureError::Refused {
        agent: agent.to_owned(),
        reason: why.to_string(),
    })?;
    let unfinished = "the agent does not have this psk for this client's key";
    connect(
        agent,
        DtlsTransport::new(socket, seal),
        config,
        (&status, unfinished),
    )
}

/// Connects over TCP with TLS to the agent at `agent`, an address and port. [`XrceConfig::key`]
/// must be set: the agent's access list has it beside the certificate.
///
/// # Errors
/// [`SecureError`]; after [`XrceConfig::connect_timeout`] if no agent answers, or if one end does
/// not take the other's certificate.
pub fn connect_tls(
    agent: &str,
    credentials: &TlsCredentials,
    config: XrceConfig,
) -> Result<Xrce, SecureError> {
    key(&config)?;
    let status = Arc::new(Status::default());
    let tls = credentials.config()?;
    let transport = TlsTransport::new(resolve(agent)?, config.mtu, tls, Arc::clone(&status));
    let unfinished = "the agent broke it off";
    connect(agent, transport, config, (&status, unfinished))
}

fn connect(
    agent: &str,
    transport: impl Transport,
    config: XrceConfig,
    (status, unfinished): (&Status, &str),
) -> Result<Xrce, SecureError> {
    Xrce::over(agent, transport, config).map_err(|error| match error {
        ConnectError::NoAgent { .. } => match status.failure(unfinished) {
            Some(reason) => SecureError::Refused {
                agent: agent.to_owned(),
                reason,
            },
            None => SecureError::Connect(error),
        },
        error => SecureError::Connect(error),
    })
}

fn key(config: &XrceConfig) -> Result<ClientKey, SecureError> {
    let allowed = "set: it is the client's identity in the agent's access list";
    let field = "key";
    let key = config.key.ok_or(SecureError::Setting { field, allowed })?;
    Ok(ClientKey(key))
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

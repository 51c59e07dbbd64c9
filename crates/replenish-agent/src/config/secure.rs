//! Ports for clients that encrypt and authenticate.

use std::net::SocketAddr;
use std::path::PathBuf;

/// The encrypted ports. They need an access list, which has the clients' keys.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SecureConfig {
    /// The UDP address to listen at for DTLS 1.2 with pre-shared keys.
    pub dtls: Option<SocketAddr>,
    /// The address and credentials for TLS 1.3 with certificates at both ends.
    pub tls: Option<TlsConfig>,
}

/// The TLS port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsConfig {
    /// The address to listen at.
    pub addr: SocketAddr,
    /// The agent's certificate in PEM form. Clients know it by its SHA-256.
    pub certificate: PathBuf,
    /// The agent's private key in PEM form.
    pub key: PathBuf,
}

impl SecureConfig {
    /// Whether there is any such port.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.dtls.is_some() || self.tls.is_some()
    }
}

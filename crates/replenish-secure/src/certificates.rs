//! Certificates: the client's own, and the agent's, which the client knows by its SHA-256.

use crate::error::SecureError;
use crate::psk::hex;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{WebPkiSupportedAlgorithms, verify_tls13_signature};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::version::TLS13;
use rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error, SignatureScheme,
    client::Resumption,
};
use sha2::{Digest, Sha256};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The SHA-256 of a certificate in DER form: how client and agent know each other's certificates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint([u8; 32]);

impl Fingerprint {
    /// Reads `sha256:` and 64 hexadecimal digits, as `replenish agent` prints it.
    ///
    /// # Errors
    /// [`SecureError::Setting`] for anything else.
    pub fn parse(text: &str) -> Result<Self, SecureError> {
        let bytes = text.strip_prefix("sha256:").and_then(hex);
        let bytes = bytes.and_then(|bytes| bytes.try_into().ok());
        bytes.map(Self).ok_or(SecureError::Setting {
            field: "fingerprint",
            allowed: "sha256: and 64 hexadecimal digits",
        })
    }

    /// That of the first certificate in a file in PEM form.
    ///
    /// # Errors
    /// [`SecureError::Credentials`] if there is none.
    pub fn of_file(path: &Path) -> Result<Self, SecureError> {
        let certificate = CertificateDer::from_pem_file(path);
        certificate
            .map(|certificate| Self::of(&certificate))
            .map_err(|why| unusable(path, &why))
    }

    fn of(certificate: &CertificateDer<'_>) -> Self {
        Self(Sha256::digest(certificate).into())
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("sha256:")?;
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// Credentials of a client over TLS, and of the agent that it talks to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsCredentials {
    /// The client's certificate in PEM form; the agent's access list has its SHA-256.
    pub certificate: PathBuf,
    /// Its private key in PEM form.
    pub key: PathBuf,
    /// The SHA-256 of the agent's certificate.
    pub agent: Fingerprint,
}

impl TlsCredentials {
    pub(crate) fn config(&self) -> Result<ClientConfig, SecureError> {
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let path = &self.certificate;
        let chain = CertificateDer::pem_file_iter(path);
        let chain = chain.and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let chain = chain.map_err(|why| unusable(path, &why))?;
        if chain.is_empty() {
            return Err(unusable(path, &"it has no certificate in PEM form"));
        }
        let key = PrivateKeyDer::from_pem_file(&self.key);
        let key = key.map_err(|why| unusable(&self.key, &why))?;
        let pinned = Pinned {
            agent: self.agent,
            algorithms: provider.signature_verification_algorithms,
        };
        let mut config = ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&TLS13])
            .map_err(|why| unusable(path, &why))?
            .dangerous() // `rustls` calls so what it does not verify itself
            .with_custom_certificate_verifier(Arc::new(pinned))
            .with_client_auth_cert(chain, key)
            .map_err(|why| unusable(&self.key, &why))?;
        config.resumption = Resumption::disabled();
        config.enable_sni = false;
        Ok(config)
    }
}

fn unusable(path: &Path, why: &dyn fmt::Display) -> SecureError {
    SecureError::Credentials {
        path: path.to_owned(),
        reason: why.to_string(),
    }
}

/// Takes one certificate of the agent, and no other.
#[derive(Debug)]
struct Pinned {
    agent: Fingerprint,
    algorithms: WebPkiSupportedAlgorithms,
}

impl ServerCertVerifier for Pinned {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _server_name: &ServerName<'_>,
        _ocsp_response: &[u8],
        _now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        if Fingerprint::of(end_entity) == self.agent {
            return Ok(ServerCertVerified::assertion());
        }
        let refused = CertificateError::ApplicationVerificationFailure;
        Err(Error::InvalidCertificate(refused))
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _cert: &CertificateDer<'_>,
        _dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Err(Error::General("TLS 1.2 is not offered".to_owned()))
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls13_signature(message, cert, dss, &self.algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.algorithms.supported_schemes()
    }
}

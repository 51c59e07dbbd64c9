//! Certificates: the agent's own, and those of clients, known by their SHA-256.

use crate::config::{AccessList, TlsConfig};
use crate::error::AgentError;
use crate::report::HandshakeError;
use replenish_xrce::wire::ClientKey;
use rustls::client::danger::HandshakeSignatureValid;
use rustls::crypto::{WebPkiSupportedAlgorithms, verify_tls13_signature};
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, UnixTime};
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::{CertificateError, DigitallySignedStruct, DistinguishedName, Error, SignatureScheme};
use sha2::{Digest, Sha256};
use std::sync::{Mutex, PoisonError};

/// The SHA-256 of a certificate.
pub(super) fn fingerprint(certificate: &CertificateDer<'_>) -> [u8; 32] {
    Sha256::digest(certificate).into()
}

/// The agent's own certificate, with those of the authorities that signed it, and its private key.
pub(super) fn own(
    config: &TlsConfig,
) -> Result<(Vec<CertificateDer<'static>>, PrivateKeyDer<'static>), AgentError> {
    let failed = |path: &std::path::Path, reason: &dyn std::fmt::Display| AgentError::Credentials {
        path: path.to_owned(),
        reason: reason.to_string(),
    };
    let path = &config.certificate;
    let chain =
        CertificateDer::pem_file_iter(path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let chain = chain.map_err(|why| failed(path, &why))?;
    if chain.is_empty() {
        return Err(failed(path, &"it has no certificate in PEM form"));
    }
    let key = PrivateKeyDer::from_pem_file(&config.key);
    let key = key.map_err(|why| match why {
        pem::Error::NoItemsFound => failed(&config.key, &"it has no private key in PEM form"),
        why => failed(&config.key, &why),
    })?;
    Ok((chain, key))
}

/// Takes the certificates of the access list. No authority is asked: a certificate that the list
/// has is good until it is taken out.
#[derive(Debug)]
pub(super) struct Listed {
    list: Mutex<AccessList>,
    /// The certificate that was refused last.
    refused: Mutex<Option<[u8; 32]>>,
    algorithms: WebPkiSupportedAlgorithms,
}

impl Listed {
    pub(super) fn new(list: AccessList, algorithms: WebPkiSupportedAlgorithms) -> Self {
        Self {
            list: Mutex::new(list),
            refused: Mutex::default(),
            algorithms,
        }
    }

    pub(super) fn replace(&self, list: AccessList) {
        *self.list.lock().unwrap_or_else(PoisonError::into_inner) = list;
    }

    /// The client that a certificate belongs to.
    pub(super) fn owner(&self, fingerprint: &[u8; 32]) -> Option<ClientKey> {
        let list = self.list.lock().unwrap_or_else(PoisonError::into_inner);
        list.owner(fingerprint)
    }

    /// The reason why a handshake failed.
    pub(super) fn failure(&self, error: &Error) -> HandshakeError {
        let refused = self
            .refused
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        match (error, refused) {
            (Error::NoCertificatesPresented, _) => HandshakeError::NoCertificate,
            (Error::InvalidCertificate(_), Some(print)) => {
                HandshakeError::UnknownCertificate(print)
            }
            _ => HandshakeError::Protocol,
        }
    }
}

impl ClientCertVerifier for Listed {
    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        &[]
    }

    fn verify_client_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        let print = fingerprint(end_entity);
        if self.owner(&print).is_some() {
            return Ok(ClientCertVerified::assertion());
        }
        *self.refused.lock().unwrap_or_else(PoisonError::into_inner) = Some(print);
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

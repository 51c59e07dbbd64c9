//! Reasons why a handshake of DTLS or TLS failed.

use std::fmt;

/// Reason why a handshake failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum HandshakeError {
    /// The client named a key for which the access list has no pre-shared key.
    UnknownIdentity,
    /// The client does not have the pre-shared key of the client that it says it is.
    WrongKey,
    /// The client shows no certificate.
    NoCertificate,
    /// The access list does not have the certificate with this SHA-256.
    UnknownCertificate([u8; 32]),
    /// The handshake was not finished in time.
    Unfinished {
        /// The longest time for a handshake, in nanoseconds.
        limit: u64,
    },
    /// The peer offers no version, cipher or form that this agent allows, or broke it off.
    Protocol,
}

impl fmt::Display for HandshakeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownIdentity => {
                f.write_str("the access list has no psk for the identity that it names")
            }
            Self::WrongKey => f.write_str("its psk is not the one of the access list"),
            Self::NoCertificate => f.write_str("it shows no certificate"),
            Self::UnknownCertificate(print) => {
                f.write_str("the access list does not have its certificate sha256:")?;
                print.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
            }
            Self::Unfinished { limit } => {
                write!(f, "not finished after {} s", *limit as f64 / 1e9)
            }
            Self::Protocol => {
                f.write_str("it offers no version and cipher of this agent, or broke it off")
            }
        }
    }
}

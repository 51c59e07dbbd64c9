//! DTLS and TLS between an XRCE client on Linux and an agent: private, unaltered, and both ends
//! authenticated.
//!
//! ```no_run
//! use replenish::Context;
//! use replenish::middleware::xrce::XrceConfig;
//! use replenish_secure::{Psk, connect_dtls};
//!
//! let psk = Psk::from_hex("00112233445566778899aabbccddeeff")?;
//! let config = XrceConfig {
//!     key: Some([0x5b, 0x1f, 0x77, 0xc0]), // the client's key in the agent's access list
//!     ..XrceConfig::default()
//! };
//! let context = Context::new(connect_dtls("192.168.1.2:8889", &psk, config)?);
//! # Ok::<(), replenish_secure::SecureError>(())
//! ```
//!
//! - [`connect_dtls`]: DTLS 1.2 over UDP with a pre-shared key, suite `PSK_AES128_CCM_8`.
//! - [`connect_tls`]: TLS 1.3 over TCP with a certificate at both ends, each known by its SHA-256.
//!
//! # What it costs
//! `dimpl` and `rustls` allocate: for a handshake, and for each record from pools and buffers of
//! their own. The transports add nothing to that after set-up, but a thread that publishes over
//! them is **not** free of allocation, as it is over plain UDP. Encryption happens in the thread
//! that publishes, on its budget, under the session's lock.
//!
//! # Structure
//! ```text
//!   connect ──┬─► dtls ──► seal: one association
//!             └─► tls ───► certificates
//!   psk   status: what became of the handshake   error   inbox: decrypted messages
//! ```
#![forbid(unsafe_code)]

mod certificates;
mod connect;
mod dtls;
mod error;
mod inbox;
mod psk;
mod seal;
mod status;
mod tls;

pub use certificates::{Fingerprint, TlsCredentials};
pub use connect::{connect_dtls, connect_tls};
pub use error::SecureError;
pub use psk::Psk;

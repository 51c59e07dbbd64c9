//! Encrypted ports: DTLS 1.2 with pre-shared keys, TLS 1.3 with certificates at both ends.
//!
//! ```text
//!   dtls: socket ─► hello + cookie: an address that has not echoed one costs no memory
//!              └──► association: a handshake, then records ──► found: messages, refusals, ends
//!         sweep: repetitions, deadlines, silence
//!   tls:  listener ─► stream: handshake, then records, on a link as TCP's
//!           └── certificates: the access list's, and the agent's own
//!   identities: pre-shared keys of the access list      gate: how many handshakes there may be
//! ```
//!
//! The protocols are state machines of `dimpl` and `rustls`; the agent's loop feeds them.

mod association;
mod certificates;
mod cookie;
mod dtls;
mod gate;
mod hello;
mod identities;
mod stream;
mod sweep;
mod tls;

pub(super) use dtls::{DtlsPort, dtls_bytes};
pub(super) use stream::{TLS_BYTES, TlsStream};
pub(super) use tls::TlsPort;

//! The agent's reports to the program: counters, snapshots and rejections.
//!
//! ```text
//!   stats      counters, read at any time
//!   snapshot   clients, entities and streams, on demand
//!   rejection  a bounded log of refused and dropped input, with its reason and subject
//!   handshake  why one of DTLS or TLS failed
//!   refusals   the last log-ins and requests that were refused
//!   recordings what boards send of their recordings
//! ```

mod handshake;
mod hex;
mod reason;
mod recordings;
mod refusals;
mod rejection;
mod snapshot;
mod stats;
mod subject;

pub use handshake::HandshakeError;
pub(crate) use hex::hex;
pub use reason::Reason;
pub use recordings::RecordedSample;
pub(crate) use recordings::{Recordings, TOPIC as RECORDER_TOPIC};
pub use refusals::Refusal;
pub(crate) use refusals::Refusals;
pub(crate) use rejection::RejectionLog;
pub use rejection::{Rejection, Rejections};
pub use snapshot::{
    BridgeSnapshot, ClientSnapshot, EntitySnapshot, ReaderSnapshot, Snapshot, StreamSnapshot,
    WriterSnapshot,
};
pub(crate) use stats::Counters;
pub use stats::Stats;
pub use subject::Subject;

//! Writers and readers: samples in and out, repairs, fragments. Bytes and time in, messages out.
//!
//! ```text
//!   send ──► writer ──► history (samples), peer_reader (what a reader has)
//!   intake, repair, liveliness ──► reader ──► store (samples), peer_writer (which numbers have arrived)
//! ```

mod history;
mod intake;
mod liveliness;
mod peer_reader;
mod peer_writer;
mod reader;
mod repair;
mod send;
mod store;
mod writer;

pub use history::Body;
pub use reader::{Reader, ReaderLimits, ReaderStats, Sample};
pub(crate) use writer::DATAGRAM_HEAD;
pub use writer::{Header, HostLimits, WriteError, Writer, WriterLimits};

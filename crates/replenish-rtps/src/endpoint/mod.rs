//! Writers and readers: samples in and out, repairs, fragments. Bytes and time in, messages out.
//!
//! ```text
//!   send ──► writer ──► history (samples), peer_reader (what a reader has), write (limits, refusals),
//!                       content (new samples, or repairs)
//!   along: heartbeats and answers in the datagrams of samples
//!   intake, repair, liveliness ──► reader ──► store (samples), peer_writer (which numbers have arrived),
//!                                             asked (when a reader asks again)
//!   shared: references to samples in a writer's memory ──► offer (the memory)
//! ```

mod along;
mod asked;
mod content;
mod history;
mod intake;
mod liveliness;
mod offer;
mod peer_reader;
mod peer_writer;
mod reader;
mod repair;
mod send;
#[cfg_attr(not(feature = "shared"), path = "shared_disabled.rs")]
mod shared;
mod store;
mod write;
mod writer;

pub(crate) use along::ANSWER_WAIT;
pub(crate) use content::Content;
pub use history::Body;
pub use reader::{Reader, ReaderLimits, ReaderStats, Sample};
#[cfg(feature = "shared")]
pub use shared::Fetch;
pub use write::{Header, HostLimits, WriteError, WriterLimits};
pub(crate) use writer::DATAGRAM_HEAD;
pub use writer::Writer;

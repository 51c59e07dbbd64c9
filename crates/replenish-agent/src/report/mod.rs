//! The agent's reports to the program: counters, snapshots and rejections.
//!
//! ```text
//!   stats      counters, read at any time
//!   snapshot   clients, entities and streams, on demand
//!   rejection  a bounded log of refused and dropped input
//! ```

mod rejection;
mod snapshot;
mod stats;

pub(crate) use rejection::RejectionLog;
pub use rejection::{Reason, Rejection, Rejections};
pub use snapshot::{
    BridgeSnapshot, ClientSnapshot, EntitySnapshot, ReaderSnapshot, Refusal, Snapshot,
    StreamSnapshot, WriterSnapshot,
};
pub(crate) use snapshot::{Refusals, hex};
pub(crate) use stats::Counters;
pub use stats::Stats;

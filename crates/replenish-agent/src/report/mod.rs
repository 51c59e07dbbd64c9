//! Counters, snapshots and rejections.

mod rejection;
mod snapshot;
mod stats;

pub(crate) use rejection::Log;
pub use rejection::{Incident, Incidents, Reason};
pub use snapshot::{
    BridgeSnapshot, ClientSnapshot, EntitySnapshot, ReaderSnapshot, Refusal, Snapshot,
    StreamSnapshot, WriterSnapshot,
};
pub(crate) use snapshot::{Refusals, hex};
pub(crate) use stats::Counters;
pub use stats::Stats;

//! The flight recorder: the last events of the dispatcher and of every worker, in memory that
//! others may read. `recorder_board.rs` takes this room's place without feature `std`.
//!
//! ```text
//!   Executor::start ─► recording ─► the program's file (or memory alone): table of threads, rings
//!                        │            ▲          └─ chains: their figures
//!   a thread begins ─► ThreadSlot ─► local: the ring of the calling thread ◄── begin, end, take, …
//!   a miss, an overrun, a panic, the stop ─► trigger ─► dumper: a thread of the idle class ─► a file
//!   dump: why and where to      place: of the live file
//!   handles, topics, marks ─► names: ids of the process, written into every table
//! ```

mod chains;
mod dump;
mod dumper;
mod local;
mod names;
mod place;
mod recording;
mod trigger;

pub(crate) use chains::{ChainFacts, ChainSlot};
pub use dump::Dump;
pub(crate) use local::{
    begin, block, chain_end, chain_stage, dropped, end, mark, miss, panicked, publish, queue, skip,
    spoiled, take, used, wake,
};
pub use names::Mark;
pub(crate) use names::{NameId, chain, handle, topic};
pub(crate) use recording::{Recording, Settings, ThreadFacts, ThreadSlot};

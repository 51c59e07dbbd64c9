//! The recording of a microcontroller: the same events at 16 bytes, in one ring for all its tasks,
//! and their way to a host.
//!
//! ```text
//!   board: tasks ─► CompactRing (4 kB, under the kernel's mask)
//!            └ a task below all others: pieces of at most 208 bytes ─► topic /replenish/recorder
//!   host:  agent ─► Relay: threads, names, events on the host's clock ─► a recording like others
//! ```
//!
//! ```text
//!   compact ── CompactEvent, CompactRing      piece ── what goes over the line
//!   relay ──── what has come of one board     image ── the relay's content as a file of version 1
//! ```

mod compact;
mod image;
mod piece;
mod relay;

pub use compact::{CompactEvent, CompactRing};
pub use image::Image;
pub use piece::{
    BoardThread, EVENTS_PER_PIECE, MAX_BOARD_NAMES, MAX_BOARD_TEXT, MAX_BOARD_THREADS, MAX_PIECE,
    Piece, PieceError, TOPIC,
};
pub use relay::{HostEvent, Relay};

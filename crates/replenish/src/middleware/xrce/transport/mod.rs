//! Ways to an agent.
//!
//! ```text
//!   Xrce ── send ────► Transport ──► descriptors: UDP datagrams · TCP with lengths · serial frames
//!        ◄─ receive ──  contract     descriptors_disabled: port, frames on a port of your own
//!        ◄─ with_descriptor ┘   the descriptor that the dispatcher's poll waits for
//! ```

mod contract;
#[cfg_attr(not(feature = "std"), path = "descriptors_disabled.rs")]
mod descriptors;

pub use contract::{Received, Sent, Transport};
pub use descriptors::*;

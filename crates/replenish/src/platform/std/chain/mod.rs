//! Chains at run time: how long it takes from the input of a first stage to the end of a last one.
//! `chain_disabled.rs` takes this room's place without feature `std`.
//!
//! ```text
//!   Executor::chain, [[chain]] ─► requested ─► process/chains: stages become links of handles
//!                                               │
//!   a callback begins ─► links: its origin, from its sample, the source's stamp or the stage before
//!      publishes ──────► current: the sample takes the origins along (in process, or over RTPS)
//!        the last stage ► across: another program's chain of that name goes on
//!      ends ───────────► state: at the last stage, latency = end − origin
//! ```

mod across;
mod current;
mod links;
mod requested;
mod state;

pub(crate) use across::{ChainName, came, sent};
pub(crate) use current::{current, resume};
pub(crate) use links::{Input as ChainInput, Link, Links, Provenance};
pub(crate) use requested::{Requested, RequestedChain};
pub(crate) use state::ChainState;

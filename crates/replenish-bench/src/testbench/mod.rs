//! A run: agent, pong and ping as separate processes, and what comes out of it.
//!
//! ```text
//!   agent ── ready(address) ─► pong, ping ── ready ─► grid to both ─► windows … ─► stop
//!     └────── any of them ends, or loses the agent: the run fails with the reason ──┘
//!   probe: whether the machine stood still meanwhile, for measurements of all kinds
//! ```

pub(crate) mod child;
pub(crate) mod measured;
pub(crate) mod orchestrator;
pub(crate) mod probe;
pub(crate) mod summary;
pub(crate) mod windows;

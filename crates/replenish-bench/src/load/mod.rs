//! The load of the paper and the arithmetic of what it must give: pure functions and data.
//!
//! - [`grid`]: windows of load on an absolute clock, shared by ping and pong.
//! - [`spec`]: what is offered and how the callbacks behave.
//! - [`theory`]: how many answers and how much CPU time a window must give.
//! - [`simulated`]: the same from the simulator.
//! - [`burn`]: the only impure part, a loop that consumes CPU time.

pub(crate) mod burn;
pub(crate) mod grid;
pub(crate) mod simulated;
pub(crate) mod spec;
pub(crate) mod theory;

pub(crate) use replenish_cli::time::{MS, Nanos, SEC};

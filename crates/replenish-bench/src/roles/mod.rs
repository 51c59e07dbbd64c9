//! The roles of a run, each a process of its own: agent, ping, pong.
//!
//! They can be started by hand, on two hosts if wanted; then they report totals. Under the
//! orchestrator ([`crate::testbench`]) they share a [`Grid`](crate::load::grid::Grid) and report
//! windows.

pub(crate) mod answers;
pub(crate) mod cpu_trace;
pub(crate) mod echo;
pub(crate) mod link;
pub(crate) mod monitor;
pub(crate) mod ping;
pub(crate) mod pong;
pub(crate) mod protocol;
pub(crate) mod sender;
pub(crate) mod supervised;
mod timing;

//! The two loops, dispatcher and worker, and the rules of a worker's rounds.

pub(crate) mod accounting;
#[cfg_attr(not(feature = "full"), path = "commands_disabled.rs")]
mod commands;
pub(crate) mod dispatcher;
#[cfg_attr(not(feature = "plan"), path = "guarantee_disabled.rs")]
pub(crate) mod guarantee;
#[cfg(feature = "full")]
pub(crate) mod mailbox;
pub(crate) mod request;
#[cfg(feature = "texts")]
pub(crate) mod round_stats;
pub(crate) mod rounds;
#[cfg(feature = "full")]
pub(crate) mod route_updates;
pub(crate) mod routes;
pub(crate) mod rules;
pub(crate) mod state;
mod worker;

#[cfg(not(feature = "full"))]
pub(crate) use crate::executor::change::fixed::{self as mailbox, self as route_updates};

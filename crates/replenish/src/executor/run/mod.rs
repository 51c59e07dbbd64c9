//! The loops of dispatcher and worker, and the parts between them.
//!
//! ```text
//!   middleware ──► dispatcher ── routes ──► inbox, mark, bell ──► worker: a loop over its state
//!                      ▲                                            │ ▲
//!      route_updates: readers that come and go                      │ │     request, guarantee: the
//!                                                                   │ │     scheduling asked for
//!   hearing: samples that the middleware hands to the worker ───────┤ │
//!   accounting: CPU time of each callback ◄─────────────────────────┘ │
//!                        mailbox ── commands: handles that come and go
//!   rules ──► rounds: rounds other than the usual ones ──► round_stats: how many there were
//! ```
//!
//! The files named `_disabled` stand in for their namesake in builds without its feature.

pub(crate) mod accounting;
#[cfg_attr(not(feature = "full"), path = "commands_disabled.rs")]
mod commands;
pub(crate) mod dispatcher;
#[cfg_attr(not(feature = "plan"), path = "guarantee_disabled.rs")]
pub(crate) mod guarantee;
mod hearing;
#[cfg_attr(not(feature = "full"), path = "mailbox_disabled.rs")]
pub(crate) mod mailbox;
pub(crate) mod request;
#[cfg_attr(not(feature = "texts"), path = "round_stats_disabled.rs")]
pub(crate) mod round_stats;
pub(crate) mod rounds;
#[cfg_attr(not(feature = "full"), path = "route_updates_disabled.rs")]
pub(crate) mod route_updates;
pub(crate) mod routes;
pub(crate) mod rules;
pub(crate) mod state;
mod worker;

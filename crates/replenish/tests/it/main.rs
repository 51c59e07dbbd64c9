//! The executor and its middleware, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;

mod actions;
mod changes;
mod changes_own;
mod changes_services;
mod dispatch;
mod durability;
mod examples;
mod groups;
mod handles;
mod interfaces;
mod lifecycle;
mod managed_nodes;
mod matching;
mod misuse;
mod node_parameters;
mod nodes;
mod parameters;
mod parity;
mod refusals;
mod rounds;
mod services;
mod spin;
mod xrce;
mod xrce_flow;
mod xrce_link;
mod xrce_restart;
mod xrce_transports;

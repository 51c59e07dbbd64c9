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
mod bare_nodes;
mod bus;
mod chains;
mod changes;
mod changes_own;
mod changes_services;
mod diagnostics;
mod dispatch;
mod drops;
mod durability;
mod examples;
mod futures;
mod groups;
mod handles;
mod heard;
mod hooks;
mod in_memory;
mod in_memory_pairs;
mod interfaces;
mod large;
mod lifecycle;
mod logs;
mod managed_nodes;
mod matching;
mod messages;
mod misses;
mod misuse;
mod node_parameters;
mod node_parameters_own;
mod nodes;
mod overlay_names;
mod parameters;
mod parity;
mod qos_events;
mod qos_promises;
mod recorder;
mod recorder_identities;
mod refusals;
mod ros_program;
mod ros_time;
mod rounds;
mod rounds_edges;
mod rtps;
mod rtps_sources;
mod services;
mod shared_memory;
mod shared_memory_pairs;
mod spin;
mod spin_rules;
mod triggers_change;
mod tutorial;
mod xrce;
mod xrce_flow;
mod xrce_link;
mod xrce_restart;
mod xrce_transports;

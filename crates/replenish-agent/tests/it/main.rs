//! The agent against scripted clients, our client and captures, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../support/bridged.rs"]
mod bridged;
#[path = "../../../replenish-xrce/tests/it/common/mod.rs"]
mod common;
#[path = "../support/schedule.rs"]
mod schedule;
#[path = "../support/session.rs"]
mod session;
#[path = "../support/sim.rs"]
mod sim;
#[path = "../support/stock_client.rs"]
mod stock_client;
#[path = "../support/mod.rs"]
mod support;
#[path = "../support/wire.rs"]
mod wire;

mod access;
mod bursts;
mod capture;
mod confirm;
mod dds;
mod dds_bounds;
mod dds_pairs;
mod endpoints;
mod forged;
mod hostile;
mod killed;
mod links;
mod load;
mod many_objects;
mod memory_bound;
mod promises;
mod qos;
mod refusals;
mod serial_line;
mod services;
mod sessions;
mod soak;
mod stock;
mod stock_bursts;
mod storm;
mod streams;
mod udp;
mod udp_pair;
mod whole_sessions;

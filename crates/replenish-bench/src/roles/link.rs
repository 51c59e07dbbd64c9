//! The way to the agent.

use super::protocol::Event;
use super::supervised;
use replenish::Context;
use replenish_cli::outcome::Failure;
use std::net::SocketAddr;

/// Connects to the agent at `address`; fails within two seconds if there is none.
pub(crate) fn connect(address: SocketAddr) -> Result<Context, Failure> {
    Context::xrce_udp(&address.to_string()).map_err(|e| {
        Failure::refused(format!(
            "no agent answers at {address}: {e} (start one: replenish agent)"
        ))
    })
}

/// Tells that the link went down or came back.
pub(crate) fn report(up: bool, detail: &str, supervised: bool) {
    if supervised {
        supervised::emit(&Event::Link {
            up,
            detail: detail.to_string(),
        });
    } else {
        eprintln!("replenish: {detail}");
    }
}

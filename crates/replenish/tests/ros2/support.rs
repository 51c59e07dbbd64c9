//! Nodes, executors and waiting.

use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::{Budget, Context, Executor, Node};
use replenish_testkit::domain::domain;
use std::time::{Duration, Instant};

/// In a domain of its own.
pub(crate) fn node(name: &str) -> (Node, u16) {
    let domain = domain();
    let config = RtpsConfig {
        domain,
        ..RtpsConfig::default()
    };
    (node_with(name, &config), domain)
}

/// On this host alone.
pub(crate) fn node_with(name: &str, config: &RtpsConfig) -> Node {
    let config = RtpsConfig {
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..config.clone()
    };
    let ctx = Context::new(Rtps::open(&config).unwrap());
    ctx.node(name).unwrap()
}

pub(crate) fn executor(node: &Node) -> Executor {
    let mut exec = Executor::new(node.context());
    exec.no_ledger();
    exec
}

/// The budget of a worker under trial.
pub(crate) fn budget() -> Budget {
    Budget::of(Duration::from_millis(20)).every(Duration::from_millis(100))
}

pub(crate) fn eventually(done: impl Fn() -> bool) -> bool {
    let begin = Instant::now();
    while !done() {
        if begin.elapsed() > Duration::from_secs(60) {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

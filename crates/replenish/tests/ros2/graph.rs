//! Our nodes in the graph of rclpy: names, types, type hashes, services, and their end.

use crate::peer::{Foreign, Peer};
use crate::support::{executor, node};
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::{ParameterOptions, Qos};
use std::time::{Duration, Instant};

type Text = BoundedString;

pub(crate) fn graph(foreign: Foreign) {
    let (node, domain) = node("/ns/ours");
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    let out = node.publisher::<Int32>("number", Qos::reliable()).unwrap();
    let mut exec = executor(&node);
    exec.worker("w")
        .subscribe(&node, "text", Qos::reliable(), |_: &Text, _| ())
        .unwrap()
        .parameters(&parameters)
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["graph"]);
    let hash = |hash: Option<&'static str>| hash.unwrap();
    let number = hash(<Int32 as replenish::msg::Message>::TYPE_HASH);
    let text = hash(<Text as replenish::msg::Message>::TYPE_HASH);
    assert_eq!(
        peer.line(),
        format!("publisher /ns ours std_msgs/msg/Int32 {number}")
    );
    assert_eq!(
        peer.line(),
        format!("subscription /ns ours std_msgs/msg/String {text}")
    );
    assert_eq!(peer.line(), "service rcl_interfaces/srv/GetParameters");
    assert_eq!(peer.line(), "node True");
    // The last holder of the context says goodbye.
    let begin = Instant::now();
    drop((running.stop(), parameters, out, node));
    assert_eq!(peer.line(), "gone");
    // By the goodbye, and not by the lease of 20 s.
    let gone = begin.elapsed();
    assert!(gone < Duration::from_secs(10), "gone after {gone:?}");
    println!("{}: gone after {gone:?}", foreign.name());
}

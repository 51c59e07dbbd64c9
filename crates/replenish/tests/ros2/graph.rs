//! Our nodes in the graph of rclpy: names, types, type hashes, services, and their end. Its nodes
//! in ours.

use crate::peer::{Foreign, Peer};
use crate::support::{eventually, executor, node};
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::{ParameterOptions, Qos};
use std::time::{Duration, Instant};

type Text = BoundedString;

pub(crate) fn graph(foreign: Foreign) {
    let (node, domain) = node("/ns/ours");
    let bare = node.context().node("/ns/bare").unwrap();
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
    assert_eq!(peer.line(), "node True bare True");
    drop(bare);
    assert_eq!(peer.line(), "bare gone");
    // The last holder of the context says goodbye.
    let begin = Instant::now();
    drop((running.stop(), parameters, out, node));
    assert_eq!(peer.line(), "gone");
    // By the goodbye, and not by the lease of 20 s.
    let gone = begin.elapsed();
    assert!(gone < Duration::from_secs(10), "gone after {gone:?}");
    println!("{}: gone after {gone:?}", foreign.name());
}

/// Nodes of rclpy by name, with what they have; gone when the peer destroys one, when its context
/// says goodbye, and when it is killed and its lease has ended.
pub(crate) fn nodes(foreign: Foreign) {
    let (node, domain) = node("/ns/ours");
    let go = node.publisher::<Int32>("/go", Qos::latched()).unwrap();
    let running = executor(&node).start().unwrap();
    let sees = |name: &str| node.graph().unwrap().node(name).is_some();
    let peer = Peer::start(foreign, domain, &["nodes"]);
    assert_eq!(peer.line(), "ready");
    let begin = Instant::now();
    assert!(eventually(|| sees("/peer") && sees("/peer/deep/second")));
    println!("{}: seen after {:?}", foreign.name(), begin.elapsed());
    assert!(sees("/ns/ours"));
    let complete = || {
        let graph = node.graph().unwrap();
        let second = graph.node("/peer/deep/second").unwrap();
        let has = |names: &[String], name: &str| names.iter().any(|known| known == name);
        assert_eq!(
            (&*second.name, &*second.namespace),
            ("second", "/peer/deep")
        );
        has(&second.publishers, "/peer/deep/number")
            && has(&second.subscriptions, "/peer/deep/text")
            && has(&second.servers, "/peer/deep/second/get_parameters")
    };
    assert!(eventually(complete), "{:?}", node.graph());
    let of_first = || {
        let graph = node.graph().unwrap();
        let first = graph.node("/peer").unwrap();
        let others = first
            .publishers
            .iter()
            .any(|name| name == "/peer/deep/number");
        assert!(!others, "{first:?}");
        first.subscriptions.iter().any(|name| name == "/go")
    };
    assert!(eventually(of_first), "{:?}", node.graph());
    go.publish(&Int32 { data: 1 }).unwrap();
    assert_eq!(peer.line(), "destroyed");
    assert!(eventually(|| !sees("/peer/deep/second")));
    assert!(sees("/peer"));
    go.publish(&Int32 { data: 2 }).unwrap();
    assert_eq!(peer.line(), "leaves");
    let begin = Instant::now();
    assert!(eventually(|| !sees("/peer")));
    // By the goodbye, and not by the lease of 20 s.
    let gone = begin.elapsed();
    assert!(gone < Duration::from_secs(10), "gone after {gone:?}");
    println!("{}: gone after {gone:?}", foreign.name());
    drop(peer);
    go.publish(&Int32 { data: 0 }).unwrap();
    let peer = Peer::start(foreign, domain, &["nodes"]);
    assert_eq!(peer.line(), "ready");
    assert!(eventually(|| sees("/peer")));
    drop(peer);
    let begin = Instant::now();
    assert!(eventually(|| !sees("/peer")));
    println!(
        "{}: killed, gone after {:?}",
        foreign.name(),
        begin.elapsed()
    );
    assert_eq!(node.graph().unwrap().nodes.len(), 1);
    drop(running.stop());
}

//! Nodes are in the graph by themselves, not by their endpoints alone.

use crate::common::{eventually, executor};
use crate::rtps::{config, open};
use replenish::middleware::InProcessBus;
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Node, Qos};
use replenish_testkit::watchdog::watchdog;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);

/// A node is there before its first endpoint, and until its last handle and its last endpoint are
/// gone, for its own side and for the other one.
fn bare_nodes_are_known(one: &Context, other: &Context) {
    let _dog = watchdog("bare nodes", LIMIT);
    let watching = other.node("watching").unwrap();
    let (mut exec, _) = executor(other);
    exec.worker("w")
        .timer(Duration::from_millis(10), |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    let bare = one.node("ns/bare").unwrap();
    let (twin, again) = (bare.clone(), one.node("ns/bare").unwrap());
    let own = one.node("own").unwrap();
    let seen = |node: &Node| node.graph().unwrap().node("/ns/bare").is_some();
    let both = |expected| eventually(|| [&watching, &own].map(seen) == [expected; 2]);
    assert!(both(true), "{:?}", watching.graph());
    let out = again.publisher::<Int32>("t", Qos::reliable()).unwrap();
    drop((bare, again));
    let ends = |node: &Node| node.graph().unwrap().topic("/ns/t").is_some();
    assert!(eventually(|| ends(&watching)));
    assert!(seen(&watching) && seen(&own));
    drop(twin); // its publisher is left
    let gone = own.publisher::<Int32>("later", Qos::reliable()).unwrap();
    assert!(eventually(|| watching
        .graph()
        .unwrap()
        .topic("/later")
        .is_some()));
    assert!(seen(&watching) && seen(&own));
    drop(out);
    assert!(both(false), "{:?}", watching.graph());
    drop((running.stop(), gone));
}

#[test]
fn bare_nodes_are_known_in_one_process() {
    let bus = InProcessBus::new();
    let [one, other] = [(); 2].map(|()| Context::new(bus.participant()));
    bare_nodes_are_known(&one, &other);
}

#[test]
fn bare_nodes_are_known_to_another_participant() {
    let config = config();
    bare_nodes_are_known(&open(&config), &open(&config));
}

/// The list of nodes has a bound: the next node is refused by name, the others stay, and there is
/// room again when one has gone.
#[test]
fn a_full_list_refuses_the_next_node_and_keeps_the_others() {
    let ctx = open(&config());
    let name = |number: usize| format!("{}/n{number}", "n".repeat(200));
    let mut nodes = Vec::new();
    let refused = loop {
        match ctx.node(&name(nodes.len())) {
            Ok(node) => nodes.push(node),
            Err(error) => break error.to_string(),
        }
        assert!(nodes.len() < 1000, "no bound");
    };
    assert!(refused.contains("ros_discovery_info"), "{refused}");
    let known = || nodes[0].graph().unwrap().nodes.len();
    assert_eq!(known(), nodes.len(), "the refused one is none of them");
    assert!(ctx.node(&name(nodes.len())).is_err());
    drop(nodes.pop());
    nodes.push(ctx.node(&name(nodes.len())).unwrap());
    assert_eq!(nodes[0].graph().unwrap().nodes.len(), nodes.len());
}

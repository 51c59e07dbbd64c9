//! Executors of ours in ROS 2 itself: genuine rclpy (Kilted, with Fast DDS) at the other
//! end, no agent. `crates/replenish-rtps/tests/peers/setup.sh` installs it; without it these trials
//! count as ignored.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod peer;

use peer::{Peer, missing};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::{Int32, String as Text};
use replenish::{Budget, Context, Descriptor, Executor, Node, ParameterOptions, Qos};
use replenish_interfaces::rcl_interfaces::srv;
use replenish_testkit::domain::domain;
use replenish_testkit::harness::{peer_trial, run};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

fn main() {
    let trial = |name, body: fn()| peer_trial(name, missing(), body);
    run(vec![
        trial("topics_there_and_back", topics),
        trial("late_joiners_both_ways", late_joiners),
        trial("node_types_and_hashes_are_seen", graph),
        trial("rclpy_asks_our_services", serve),
        trial("we_ask_services_of_rclpy", ask),
    ]);
}

/// In a domain of its own.
fn node(name: &str) -> (Node, u16) {
    let domain = domain();
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        ..RtpsConfig::default()
    };
    let ctx = Context::new(Rtps::open(&config).unwrap());
    (ctx.node(name).unwrap(), domain)
}

fn executor(node: &Node) -> Executor {
    let mut exec = Executor::new(node.context());
    exec.no_ledger();
    exec
}

fn eventually(done: impl Fn() -> bool) -> bool {
    let begin = Instant::now();
    while !done() {
        if begin.elapsed() > Duration::from_secs(60) {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// 200 numbers from rclpy come back to it through a worker with a budget: reliable, best effort.
fn topics() {
    let (node, domain) = node("/peer/ours");
    let mut exec = executor(&node);
    for (kind, qos) in [
        ("reliable", Qos::reliable().keep_last(500)),
        ("best_effort", Qos::best_effort().keep_last(500)),
    ] {
        let back = node
            .publisher::<Int32>(&format!("{kind}_from_ours"), qos)
            .unwrap();
        exec.worker(kind)
            .budget(Budget::of(Duration::from_millis(20)).every(Duration::from_millis(100)))
            .subscribe(
                &node,
                &format!("{kind}_to_ours"),
                qos,
                move |m: &Int32, _| back.publish(m),
            )
            .unwrap();
    }
    let running = exec.start().unwrap();
    let peer = Peer::start(domain, &["topics", "200"]);
    assert_eq!(peer.line(), "reliable 200 True");
    assert_eq!(peer.line(), "best_effort 200 True");
    for kind in ["reliable", "best_effort"] {
        let id = format!("/peer/ours/sub:/peer/{kind}_to_ours");
        let stats = || running.stats(&id).unwrap();
        // And those by which both got to know each other.
        assert!(stats().received >= 200, "{kind}: {:?}", stats());
        // The last callback is counted after the peer has its answer.
        let all_executed = || Some(stats()).is_some_and(|s| s.executed == s.received);
        assert!(eventually(all_executed), "{kind}: {:?}", stats());
    }
    drop(running.stop());
}

fn late_joiners() {
    let (node, domain) = node("/peer/ours");
    let latched = Qos::reliable().keep_last(3).transient_local();
    let out = node
        .publisher::<Text>("latched_from_ours", latched)
        .unwrap();
    for text in ["1", "22", "333"] {
        let data = text.try_into().unwrap();
        out.publish(&Text { data }).unwrap();
    }
    let peer = Peer::start(domain, &["late"]);
    assert_eq!(peer.line(), "ready");
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    let mut exec = executor(&node);
    exec.worker("late")
        .subscribe(&node, "latched_to_ours", latched, move |m: &Text, _| {
            sink.lock().unwrap().push(m.data.to_string());
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert_eq!(peer.line(), "late 1 22 333");
    assert!(eventually(|| heard.lock().unwrap().len() == 3));
    assert_eq!(*heard.lock().unwrap(), ["one", "two", "three"]);
    drop(running.stop());
}

fn graph() {
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
    let peer = Peer::start(domain, &["graph"]);
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
    drop((running.stop(), parameters, out, node));
    assert_eq!(peer.line(), "gone");
}

/// rclpy sets and gets a parameter of ours a hundred times.
fn serve() {
    let (node, domain) = node("/peer/ours");
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    parameters.declare("gain", 0, Descriptor::new()).unwrap();
    let mut exec = executor(&node);
    exec.worker("parameters").parameters(&parameters).unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(domain, &["ask", "/peer/ours"]);
    assert_eq!(peer.line(), "asked 100");
    drop(running.stop());
}

/// We ask rclpy's own service a hundred times.
fn ask() {
    let (node, domain) = node("/peer/ours");
    let limit = Duration::from_secs(60);
    let client = node
        .client::<srv::GetParameters>("/peer/peer/get_parameters", Qos::services(), limit)
        .unwrap();
    let answers = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&answers);
    let mut exec = executor(&node);
    exec.worker("client")
        .replies(
            &client,
            move |reply: Result<&srv::GetParametersResponse, _>, _| {
                let values = &reply.unwrap().values;
                sink.lock()
                    .unwrap()
                    .push(values.first().map(|value| value.integer_value));
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(domain, &["serve"]);
    assert_eq!(peer.line(), "ready");
    assert!(client.wait_for_server(limit).unwrap());
    let mut request = srv::GetParametersRequest::default();
    request.names.push("gain".into());
    for count in 1..=100 {
        client.call(&request).unwrap();
        assert!(
            eventually(|| answers.lock().unwrap().len() == count),
            "{count}"
        );
    }
    assert!(
        answers
            .lock()
            .unwrap()
            .iter()
            .all(|value| *value == Some(3))
    );
    drop(running.stop());
}

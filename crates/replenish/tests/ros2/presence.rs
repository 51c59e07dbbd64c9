//! When we are seen, and when we are gone: after a drop, after a kill, after a pause.

use crate::peer::{Foreign, Peer};
use crate::support::{executor, node_with};
use crate::types;
use replenish::middleware::rtps::RtpsConfig;
use replenish::msg::Message;
use replenish::msg::std_msgs::Int32;
use replenish::{Executor, Node, Publisher, Qos};
use replenish_testkit::domain::domain;
use replenish_testkit::program::{Running, Scratch};
use std::fmt::Write;
use std::time::{Duration, Instant};

/// The variable by which this program runs as the node that is killed and paused.
const CHILD: &str = "REPLENISH_ROS2_CHILD";
/// The child's lease: the shortest there is.
const LEASE: Duration = Duration::from_secs(1);
/// The longest that discovery may take, beyond the lease, on a busy machine.
const SLACK: Duration = Duration::from_secs(10);
/// Pauses that are longer than the lease.
const PAUSES: usize = 20;

/// The publishers of every message of the crate, and a line about each for the peer.
#[derive(Default)]
struct EveryMessage {
    publishers: Vec<Box<dyn std::any::Any>>,
    lines: String,
}

impl EveryMessage {
    fn publish<M: Message + Send + 'static>(&mut self, node: &Node) {
        if !M::TYPE_NAME.contains("/msg/") {
            return;
        }
        let topic = format!("/types/{}", M::TYPE_NAME);
        let publisher: Publisher<M> = node.publisher(&topic, Qos::reliable()).unwrap();
        let (name, hash) = (M::TYPE_NAME, M::TYPE_HASH.unwrap());
        writeln!(self.lines, "{topic} {name} {hash}").unwrap();
        self.publishers.push(Box::new(publisher));
    }
}

/// The type hash of every message, as `get_publishers_info_by_topic` shows it and as the peer's own
/// packages have it.
pub(crate) fn hashes(foreign: Foreign) {
    let config = RtpsConfig {
        domain: domain(),
        own_endpoints: 1000,
        ..RtpsConfig::default()
    };
    let scratch = Scratch::new(&format!("hashes-{}", foreign.name()));
    let file = scratch.path("types");
    let mut lines = String::new();
    macro_rules! describe {
        ($message:ty) => {
            if <$message>::TYPE_NAME.contains("/msg/") {
                let (name, hash) = (<$message>::TYPE_NAME, <$message>::TYPE_HASH.unwrap());
                writeln!(lines, "/types/{name} {name} {hash}").unwrap();
            }
        };
    }
    types::for_each_type!(describe);
    std::fs::write(&file, &lines).unwrap();
    let peer = Peer::start(foreign, config.domain, &["hashes", file.to_str().unwrap()]);
    assert_eq!(peer.line(), "ready");
    let begin = Instant::now();
    let node = node_with("/peer/ours", &config);
    let mut every = EveryMessage::default();
    macro_rules! publish {
        ($message:ty) => {
            every.publish::<$message>(&node);
        };
    }
    types::for_each_type!(publish);
    assert_eq!(every.lines, lines);
    let running = executor(&node).start().unwrap();
    let count = every.publishers.len();
    assert!(count > 150);
    assert_eq!(peer.line(), format!("seen {count}"));
    let seen = begin.elapsed();
    assert!(seen < SLACK, "seen after {seen:?}");
    let genuine = peer.line();
    let differ = genuine.split_once(" differ").unwrap().1;
    assert_eq!(differ, "", "{genuine}");
    println!("{}: {count} seen after {seen:?}, {genuine}", foreign.name());
    drop(running.stop());
}

/// The node that is killed and paused, if this process is to be it.
pub(crate) fn child() {
    let Some(domain) = std::env::var(CHILD).ok().and_then(|text| text.parse().ok()) else {
        return;
    };
    let config = RtpsConfig {
        domain,
        lease: LEASE,
        ..RtpsConfig::default()
    };
    let node = node_with("/peer/ours", &config);
    let mut exec = executor(&node);
    serve(&node, &mut exec);
    exec.spin().unwrap();
    std::process::exit(0);
}

/// Numbers, and an answer to each ping.
pub(crate) fn serve(node: &Node, exec: &mut Executor) {
    let number = node.publisher::<Int32>("number", Qos::reliable()).unwrap();
    let pong = node.publisher::<Int32>("pong", Qos::reliable()).unwrap();
    let mut data = 0;
    exec.worker("w")
        .timer(Duration::from_millis(20), move |_| {
            data += 1;
            number.publish(&Int32 { data })
        })
        .unwrap()
        .subscribe(node, "ping", Qos::reliable(), move |m: &Int32, _| {
            pong.publish(m)
        })
        .unwrap();
}

/// A node that is paused for longer than its lease is back each time; a node that is killed is gone
/// when its lease has ended.
pub(crate) fn pauses(foreign: Foreign) {
    let domain = domain();
    let this = std::env::current_exe().unwrap();
    let variable = format!("{CHILD}={domain}");
    let mut child = Running::start("/usr/bin/env", &[&variable, this.to_str().unwrap()]);
    let peer = Peer::start(foreign, domain, &["watch"]);
    let back = |pause: usize| {
        for line in ["seen", "heard", "answered"] {
            assert_eq!(peer.line(), line, "after {pause} pauses");
        }
    };
    back(0);
    for pause in 1..=PAUSES {
        child.signal("STOP");
        assert_eq!(peer.line(), "gone", "pause {pause}");
        std::thread::sleep(LEASE / 4);
        child.signal("CONT");
        back(pause);
    }
    let begin = Instant::now();
    child.signal("KILL");
    assert_eq!(peer.line(), "gone");
    let gone = begin.elapsed();
    assert!(gone < LEASE + SLACK, "gone after {gone:?}");
    child.end(Duration::from_secs(60));
}

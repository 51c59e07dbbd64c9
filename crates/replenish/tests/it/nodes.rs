//! Settings of a node besides its name: a namespace, and the domain of its context.

use crate::common::agent::TestAgent;
use crate::common::{eventually, executor};
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Qos};
use replenish_testkit::watchdog::watchdog;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);

/// Relative names are the namespace's, private ones the node's, absolute ones belong to neither.
#[test]
fn names_belong_to_the_namespace_to_the_node_or_to_nobody() {
    let node = Context::in_process().node("robot/arm").unwrap();
    assert_eq!(node.name(), "/robot/arm");
    let full = |topic| {
        let publisher = node.publisher::<Int32>(topic, Qos::reliable());
        publisher.unwrap().topic().to_owned()
    };
    assert_eq!(full("t"), "/robot/t");
    assert_eq!(full("~/t"), "/robot/arm/t");
    assert_eq!(full("/t"), "/t");
}

/// Contexts of two domains at one agent do not hear of each other.
#[test]
fn domains_are_apart() {
    let _dog = watchdog("domains", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let context = |domain| {
        let config = XrceConfig {
            domain,
            ..XrceConfig::default()
        };
        Context::new(Xrce::udp_with(&agent.address.to_string(), config).unwrap())
    };
    let (zero, also_zero, seven) = (context(0), context(0), context(7));
    let publish = |ctx: &Context| {
        let node = ctx.node("talks").unwrap();
        node.publisher::<Int32>("t", Qos::reliable()).unwrap()
    };
    let (here, there) = (publish(&zero), publish(&seven));
    let (mut exec, _) = executor(&also_zero);
    let node = also_zero.node("hears").unwrap();
    exec.worker("w")
        .subscribe(&node, "t", Qos::reliable(), |m: &Int32, _| {
            assert_eq!(m.data, 0, "from another domain");
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| {
        there.publish(&Int32 { data: 7 }).ok();
        here.publish(&Int32 { data: 0 }).ok();
        running.stats("/hears/sub:/t").unwrap().executed >= 10
    }));
    let report = running.stop();
    let stats = report.handle("/hears/sub:/t").unwrap().stats;
    assert!(!stats.panicked, "{report}");
}

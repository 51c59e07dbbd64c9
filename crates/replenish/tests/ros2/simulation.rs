//! A simulation in rclpy: it drives `/clock`, backwards too, and knows our node by its new names.

use crate::peer::{Foreign, Peer};
use crate::support::executor;
use replenish::args::{Environment, RosArgs};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::builtin_interfaces::Time;
use replenish::{Context, Qos};
use replenish_interfaces::test_msgs::srv::Empty;
use replenish_testkit::domain::domain;
use std::time::Duration;

/// The arguments of our program, as a user of a simulation types them.
const LINE: &str = "program --ros-args -p use_sim_time:=true -r __node:=rover -r __ns:=/sim \
                    -r beat:=/peer/beats -r now:=/peer/now -r reset:=/peer/reset";

/// rclpy is the simulator. It reads the time and the beats of our node's timer.
pub(crate) fn clock(foreign: Foreign) {
    let config = RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    let line = LINE.split_whitespace().map(String::from);
    let args = RosArgs::parse(line, &Environment::default()).unwrap();
    let ctx = Context::new(Rtps::open(&config).unwrap()).with_args(args);
    let node = ctx.node("arm").unwrap();
    let beats = node.publisher::<Time>("beat", Qos::reliable()).unwrap();
    let now = node.publisher::<Time>("now", Qos::reliable()).unwrap();
    let mut exec = executor(&node);
    let (beating, telling, told) = (node.clone(), node.clone(), beats.clone());
    exec.worker("beats")
        .ros_timer(&node, Duration::from_secs(1), move |_| {
            beats.publish(&beating.now())
        })
        .unwrap();
    exec.worker("now")
        .timer(Duration::from_millis(20), move |_| {
            // The first beat is not lost: rclpy waits for a time.
            if told.subscriptions().unwrap() == 0 {
                return Ok(());
            }
            now.publish(&telling.now())
        })
        .unwrap()
        .serve::<Empty, _>(&node, "reset", Qos::services(), |_, _, _| {})
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, config.domain, &["simulate"]);
    // One message brings the time from 101 s to 105.5 s: one beat. From 50 s on all begins anew.
    assert_eq!(peer.line(), "beats [101.0, 105.5, 51.0, 52.25]");
    assert_eq!(peer.line(), "node True False");
    assert_eq!(
        peer.line(),
        "/peer/beats ['builtin_interfaces/msg/Time'] /peer/now ['builtin_interfaces/msg/Time']"
    );
    assert_eq!(peer.line(), "/peer/reset True");
    drop(running.stop());
}

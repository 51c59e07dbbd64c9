//! The XRCE adapter over a bad link: a relay between it and the agent loses datagrams.

use crate::common::agent::TestAgent;
use crate::common::relay::Relay;
use crate::common::{eventually, executor};
use replenish::middleware::LinkState;
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{Context, PublishError, Qos, RunningExecutor};
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);

fn publish(publish: impl Fn() -> Result<(), PublishError>) {
    let sent = || match publish() {
        Ok(()) => true,
        Err(PublishError::Full) => false,
        Err(error) => panic!("{error}"),
    };
    assert!(eventually(sent), "the output queue stays full");
}

/// An executor that notes the numbers it hears on `/numbers`.
fn listener(ctx: &Context, qos: Qos) -> (RunningExecutor, Arc<Mutex<Vec<i32>>>) {
    let heard = Arc::new(Mutex::new(Vec::new()));
    let node = ctx.node("listener").unwrap();
    let (mut exec, _) = executor(ctx);
    let sink = Arc::clone(&heard);
    exec.worker("numbers")
        .subscribe(&node, "numbers", qos, move |m: &Int32, _| {
            sink.lock().unwrap().push(m.data);
        })
        .unwrap();
    (exec.start().unwrap(), heard)
}

#[test]
fn reliable_samples_survive_a_lossy_link_once_and_in_order() {
    const SAMPLES: i32 = 300;
    let _dog = watchdog("lossy link", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let relay = Relay::start(agent.address);
    // Enough patience that a run of bad luck with pings is no lost agent.
    let mut config = XrceConfig::default();
    config.ping.silence_limit = 10_000_000_000;
    let ctx = Context::new(Xrce::udp_with(&relay.address.to_string(), config).unwrap());
    let qos = Qos::reliable().keep_all(64);
    let node = ctx.node("talker").unwrap();
    let numbers = node.publisher::<Int32>("numbers", qos).unwrap();
    let bulk = node.publisher::<UInt8MultiArray>("bulk", qos).unwrap();
    let (running, heard) = listener(&ctx, qos);
    relay.lose(10);
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(3000, 7).unwrap();
    for data in 0..SAMPLES {
        publish(|| numbers.publish(&Int32 { data }));
        if data % 10 == 0 {
            publish(|| bulk.publish(&payload)); // fragments in between
        }
    }
    let all: Vec<i32> = (0..SAMPLES).collect();
    assert!(eventually(|| heard.lock().unwrap().len() >= all.len()));
    assert_eq!(*heard.lock().unwrap(), all);
    assert!(
        relay.lost() > 50,
        "only {} datagrams were lost",
        relay.lost()
    );
    relay.lose(0);
    running.stop();
}

#[test]
fn after_a_cut_link_the_session_is_new_and_nothing_comes_twice() {
    let _dog = watchdog("cut link", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let relay = Relay::start(agent.address);
    let ctx = Context::xrce_udp(&relay.address.to_string()).unwrap();
    let far = agent.context();
    let qos = Qos::reliable();
    let node = far.node("talker").unwrap();
    let numbers = node.publisher::<Int32>("numbers", qos).unwrap();
    let (far_running, _) = listener(&far, qos); // so that the talker's session is looked after
    let (running, heard) = listener(&ctx, qos);
    publish(|| numbers.publish(&Int32 { data: 1 }));
    assert!(eventually(|| heard.lock().unwrap().len() == 1));

    relay.lose(100);
    assert!(eventually(|| ctx.link() != LinkState::Up));
    publish(|| numbers.publish(&Int32 { data: 2 })); // the agent still has the old session's reader
    relay.lose(0);
    assert!(eventually(|| ctx.link() == LinkState::Up));
    publish(|| numbers.publish(&Int32 { data: 3 }));
    assert!(eventually(|| heard.lock().unwrap().contains(&3)));
    std::thread::sleep(Duration::from_millis(300)); // longer than a heartbeat of the old session
    let heard = heard.lock().unwrap().clone();
    assert_eq!(heard, [1, 3], "2 was for a session that is gone");
    running.stop();
    far_running.stop();
}

#[test]
fn a_client_that_comes_back_replaces_its_old_self() {
    let _dog = watchdog("same key", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let address = agent.address.to_string();
    let config = XrceConfig {
        key: Some([7, 7, 7, 7]),
        ..XrceConfig::default()
    };
    let connect = || Context::new(Xrce::udp_with(&address, config).unwrap());
    let qos = Qos::reliable().keep_all(64);
    let dead = connect();
    let dead_reader = {
        let (exec, heard) = listener(&dead, qos);
        exec.stop();
        heard
    };
    let alive = connect(); // the dead one has not logged out
    let node = alive.node("talker").unwrap();
    let numbers = node.publisher::<Int32>("numbers", qos).unwrap();
    let (running, heard) = listener(&alive, qos);
    for data in 0..20 {
        publish(|| numbers.publish(&Int32 { data }));
    }
    assert!(eventually(|| heard.lock().unwrap().len() >= 20));
    assert_eq!(*heard.lock().unwrap(), (0..20).collect::<Vec<_>>());
    assert!(dead_reader.lock().unwrap().is_empty());
    running.stop();
    drop(dead);
}

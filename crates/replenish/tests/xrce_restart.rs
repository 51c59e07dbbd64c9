//! The agent is killed during reliable traffic, again and again, and another one takes its place.
//!
//! What the client knew to be acknowledged, and the agent had handed on, came once; what was not
//! acknowledged is sent again, and may come twice.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod common;

use common::eventually;
use replenish::Qos;
use replenish::middleware::xrce::Xrce;
use replenish::middleware::{
    EndpointSpec, Interest, LinkState, Middleware, PublishError, Room, WriterId,
};
use replenish::qos::IngressLimit;
use replenish_agent::{Agent, AgentConfig, RunningAgent};
use replenish_os::clock;
use replenish_testkit::watchdog::watchdog;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

fn agent_at(addr: &str) -> RunningAgent {
    let addr = addr.parse().unwrap();
    let config = AgentConfig {
        addr,
        ..AgentConfig::default()
    };
    Agent::bind(&config).unwrap().spawn().unwrap()
}

fn spec(qos: Qos) -> EndpointSpec<'static> {
    EndpointSpec {
        node: "/restart",
        topic: "/steady",
        type_name: "std_msgs/msg/UInt8MultiArray",
        dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
        qos,
        max_size: 2000,
        ingress: IngressLimit::none(),
    }
}

type Heard = Arc<Mutex<Vec<u32>>>;

/// Runs the session as a dispatcher does; notes the numbers it gets.
fn dispatch(
    middleware: &Arc<Xrce>,
    interest: Interest,
    stop: &Arc<AtomicBool>,
) -> (JoinHandle<()>, Heard) {
    let heard = Heard::default();
    let (middleware, stop, sink) = (Arc::clone(middleware), Arc::clone(stop), Arc::clone(&heard));
    let thread = thread::spawn(move || {
        while !stop.load(Ordering::SeqCst) {
            let deadline = clock::monotonic() + 10_000_000;
            middleware.wait(&interest, Some(deadline)).unwrap();
            let mut heard = sink.lock().unwrap();
            middleware
                .take(&interest, &mut |_, _, bytes| {
                    let (number, rest) = bytes.split_first_chunk().unwrap();
                    assert!(
                        rest.iter().all(|byte| *byte == number[0]),
                        "a damaged sample"
                    );
                    heard.push(u32::from_le_bytes(*number));
                    Room::Left
                })
                .unwrap();
        }
    });
    (thread, heard)
}

fn sample(number: u32) -> Vec<u8> {
    let bytes = number.to_le_bytes();
    let len = if number.is_multiple_of(10) { 2000 } else { 100 };
    let mut sample = vec![bytes[0]; len];
    sample[..4].copy_from_slice(&bytes);
    sample
}

/// Publishes `number`, waiting while there is no room; false while there is no agent.
fn publish(middleware: &Xrce, writer: WriterId, number: u32) -> bool {
    loop {
        match middleware.publish(writer, &sample(number)) {
            Ok(()) => return true,
            Err(PublishError::Full) => thread::sleep(Duration::from_micros(200)),
            Err(PublishError::LinkDown) => return false,
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn what_was_acknowledged_came_once_and_traffic_resumes_within_two_seconds() {
    let _dog = watchdog("restart", Duration::from_secs(120));
    let agent = agent_at("127.0.0.1:0");
    let address = agent.local_addr().to_string();
    let mut agent = Some(agent);
    let talker = Arc::new(Xrce::udp(&address).unwrap());
    let listener = Arc::new(Xrce::udp(&address).unwrap());
    let qos = Qos::reliable().keep_all(256);
    let writer = talker.create_writer(&spec(qos)).unwrap();
    let reader = listener.create_reader(&spec(qos)).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let mut interest = Interest::empty();
    interest.insert(reader);
    let (talking, _) = dispatch(&talker, Interest::empty(), &stop);
    let (listening, heard) = dispatch(&listener, interest, &stop);

    let mut random = 7_u64;
    let mut next = 0_u32;
    // Numbers that the talker knew to be acknowledged and the listener had before a kill.
    let mut certain = Vec::new();
    for round in 0..4 {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let count = 100 + (random >> 40) as u32 % 300;
        let first = next;
        let mut acknowledged = first;
        for _ in 0..count {
            assert!(publish(&talker, writer, next), "round {round}: no agent");
            next += 1;
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            thread::sleep(Duration::from_micros(random >> 55));
            if talker.stats().unacknowledged == 0 {
                acknowledged = next;
            }
        }
        assert!(
            acknowledged > first,
            "round {round}: nothing was acknowledged"
        );
        assert!(eventually(|| {
            let heard = heard.lock().unwrap();
            heard.last().is_some_and(|last| *last + 1 >= acknowledged)
        }));
        certain.extend(first..acknowledged);
        for _ in 0..5 {
            publish(&talker, writer, next);
            next += 1;
        }
        agent.take().unwrap().stop().unwrap();
        for _ in 0..5 {
            publish(&talker, writer, next); // to nobody
            next += 1;
        }
        let killed = Instant::now();
        assert!(eventually(|| talker.link() != LinkState::Up));
        let noticed = killed.elapsed();
        assert!(
            noticed < Duration::from_millis(1_300),
            "noticed after {noticed:?}"
        );
        thread::sleep(Duration::from_millis(100 * round));
        agent = Some(agent_at(&address));
        let restarted = Instant::now();
        let both = || talker.link() == LinkState::Up && listener.link() == LinkState::Up;
        assert!(eventually(both));
        let before = heard.lock().unwrap().len();
        assert!(publish(&talker, writer, next));
        next += 1;
        assert!(eventually(|| heard.lock().unwrap().len() > before));
        let resumed = restarted.elapsed();
        assert!(
            resumed < Duration::from_secs(2),
            "round {round}: resumed after {resumed:?}"
        );
    }
    assert!(eventually(
        || heard.lock().unwrap().last() == Some(&(next - 1))
    ));
    stop.store(true, Ordering::SeqCst);
    talking.join().unwrap();
    listening.join().unwrap();

    let mut times: BTreeMap<u32, u64> = BTreeMap::new();
    for number in heard.lock().unwrap().iter() {
        *times.entry(*number).or_default() += 1;
    }
    let stats = talker.stats().link;
    println!("{next} published, {} heard, {stats:?}", times.len());
    assert_eq!((stats.losses, stats.lost), (4, 0));
    for number in &certain {
        assert_eq!(times.get(number), Some(&1), "{number} of {certain:?}");
    }
    let again: u64 = times.values().map(|times| times - 1).sum();
    assert!(
        again <= stats.carried,
        "{again} came twice, {} were sent again",
        stats.carried
    );
    assert!(stats.carried >= 4 * 5, "{stats:?}");
    drop(agent);
}

//! Flow over XRCE: topics that do not wait for each other, subscriptions that hold their agent
//! back, and limits on what the agent may send.

use crate::common::agent::TestAgent;
use crate::common::{eventually, executor};
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::middleware::{EndpointSpec, Interest, Middleware, PublishError, Room};
use replenish::msg::std_msgs::Int32;
use replenish::{Error, IngressLimit, Qos, Topic};
use replenish_os::clock;
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(120);

fn spec(topic: &'static str, qos: Qos) -> EndpointSpec<'static> {
    EndpointSpec {
        node: "/flow",
        topic,
        type_name: "std_msgs/msg/UInt8MultiArray",
        dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
        type_hash: None,
        qos,
        max_size: 400,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

#[test]
fn a_full_normal_topic_does_not_hold_up_a_real_time_one() {
    let _dog = watchdog("criticality", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let middleware = Xrce::udp(&agent.address.to_string()).unwrap();
    let qos = Qos::reliable();
    let bulk = middleware.create_writer(&spec("/bulk", qos)).unwrap();
    let urgent = middleware
        .create_writer(&spec("/urgent", qos.real_time()))
        .unwrap();
    let reader = middleware
        .create_reader(&spec("/urgent", qos.real_time()))
        .unwrap();
    // The session does not run, so that the queue of the normal topic fills.
    while middleware.publish(bulk, &[1; 400]).is_ok() {}
    assert_eq!(middleware.publish(bulk, &[1; 400]), Err(PublishError::Full));
    middleware.publish(urgent, b"now").unwrap();
    let mut interest = Interest::empty();
    interest.insert(reader);
    let mut heard = 0;
    let end = Instant::now() + Duration::from_secs(60);
    while heard == 0 && Instant::now() < end {
        let deadline = clock::monotonic() + 10_000_000;
        middleware.wait(&interest, Some(deadline)).unwrap();
        let mut sink = |_, _: &_, bytes: &[u8]| {
            assert_eq!(bytes, b"now");
            heard += 1;
            Room::Left
        };
        middleware.take(&mut interest, &mut sink).unwrap();
    }
    assert_eq!(heard, 1);
}

#[test]
fn a_slow_keep_all_subscription_loses_nothing() {
    const SAMPLES: i32 = 2_000;
    let _dog = watchdog("keep all", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let (near, far) = (agent.context(), agent.context());
    let qos = Qos::reliable().keep_all(8);
    let talker = near.node("talker").unwrap();
    let numbers = talker
        .publisher::<Int32>("numbers", Qos::reliable().keep_all(4096))
        .unwrap();
    let (exec, _) = executor(&near);
    let near_running = exec.start().unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let listener = far.node("listener").unwrap();
    let (mut exec, _) = executor(&far);
    let sink = Arc::clone(&heard);
    exec.worker("slow")
        .subscribe(&listener, "numbers", qos, move |m: &Int32, _| {
            if m.data % 64 == 0 {
                std::thread::sleep(Duration::from_millis(5));
            }
            sink.lock().unwrap().push(m.data);
        })
        .unwrap();
    let running = exec.start().unwrap();
    for data in 0..SAMPLES {
        numbers
            .publish_within(&Int32 { data }, Duration::from_secs(5))
            .unwrap();
        // The agent keeps a bounded number of samples for a reader.
        while data > heard.lock().unwrap().last().copied().unwrap_or(0) + 60 {
            std::thread::sleep(Duration::from_micros(200));
        }
    }
    assert!(eventually(
        || heard.lock().unwrap().len() >= SAMPLES as usize
    ));
    assert_eq!(*heard.lock().unwrap(), (0..SAMPLES).collect::<Vec<_>>());
    let report = running.report();
    assert!(
        report.handles.iter().all(|h| h.stats.dropped == 0),
        "{report:?}"
    );
    running.stop();
    near_running.stop();
}

/// b209253 dropped what a reader had no room for after a second: of 1000 acknowledged samples 464
/// arrived.
#[test]
fn a_keep_all_subscription_that_stands_still_for_seconds_loses_nothing() {
    const SAMPLES: i32 = 1_000;
    let _dog = watchdog("stands still", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let (near, far) = (agent.context(), agent.context());
    // The publisher's own session reads, too: it must be able to ask for more while it waits.
    let talker = near.node("talker").unwrap();
    let numbers = talker
        .publisher::<Int32>("numbers", Qos::reliable().keep_all(64).real_time())
        .unwrap();
    let mut heard = Vec::new();
    let mut executors = Vec::new();
    for (context, name) in [(&near, "own"), (&far, "other")] {
        let node = context.node(name).unwrap();
        let (mut exec, _) = executor(context);
        let got = Arc::new(Mutex::new(Vec::new()));
        let sink = Arc::clone(&got);
        exec.worker("slow")
            .subscribe(
                &node,
                "numbers",
                Qos::reliable().keep_all(8),
                move |m: &Int32, _| {
                    if m.data == 3 {
                        std::thread::sleep(Duration::from_millis(2_500));
                    }
                    sink.lock().unwrap().push(m.data);
                },
            )
            .unwrap();
        executors.push(exec.start().unwrap());
        heard.push(got);
    }
    for data in 0..SAMPLES {
        numbers
            .publish_within(&Int32 { data }, Duration::from_secs(20))
            .unwrap();
    }
    let expected: Vec<i32> = (0..SAMPLES).collect();
    for got in heard {
        let all = eventually(|| got.lock().unwrap().len() >= SAMPLES as usize);
        let heard = got.lock().unwrap().clone();
        assert!(all, "{heard:?}; {:#?}", agent.snapshot());
        assert_eq!(*got.lock().unwrap(), expected);
    }
    executors
        .into_iter()
        .for_each(|running| drop(running.stop()));
}

/// With b209253 the client did not count a sample that was longer than what it could put together,
/// and the agent did: after as many as the reader keeps, both waited for the other for ever.
#[test]
fn samples_that_are_too_long_stop_no_keep_all_reader_and_are_counted() {
    let _dog = watchdog("too long", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let address = agent.address.to_string();
    let config = XrceConfig {
        max_sample: 1_000,
        ..XrceConfig::default()
    };
    let far = Xrce::udp_with(&address, config).unwrap();
    let near = Xrce::udp(&address).unwrap();
    let qos = Qos::reliable().keep_all(10);
    let reader = far.create_reader(&spec("/mixed", qos)).unwrap();
    let long = EndpointSpec {
        max_size: 10_000,
        ..spec("/mixed", qos)
    };
    let writer = near.create_writer(&long).unwrap();
    let mut interest = Interest::empty();
    interest.insert(reader);
    let (mut sent, mut heard) = (0_u32, Vec::new());
    let end = Instant::now() + Duration::from_secs(60);
    while heard.len() < 100 && Instant::now() < end {
        // Four of five are too long.
        let mut sample = sent.to_le_bytes().to_vec();
        if sent % 5 != 0 {
            sample.resize(5_000, 0);
        }
        if sent < 500 && near.publish(writer, &sample).is_ok() {
            sent += 1;
        }
        let soon = clock::monotonic() + 1_000_000;
        near.wait(&Interest::empty(), Some(soon)).unwrap();
        near.take(&mut Interest::empty(), &mut |_, _: &_, _: &[u8]| Room::Left)
            .unwrap();
        let soon = clock::monotonic() + 1_000_000;
        far.wait(&interest, Some(soon)).unwrap();
        let mut sink = |_, _: &_, bytes: &[u8]| {
            heard.push(u32::from_le_bytes(bytes.try_into().unwrap()));
            Room::Left
        };
        far.take(&mut interest, &mut sink).unwrap();
    }
    assert_eq!(heard, (0..500).step_by(5).collect::<Vec<u32>>());
    // The last of them may be still to come.
    assert!((396..=400).contains(&far.lost(reader)));
}

#[test]
fn a_flood_is_stopped_at_the_agent() {
    let _dog = watchdog("ingress", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let (near, far) = (agent.context(), agent.context());
    let qos = Qos::best_effort().keep_last(1);
    let talker = near.node("talker").unwrap();
    let flood = talker.publisher::<Int32>("flood", qos).unwrap();
    let heard = Arc::new(AtomicI32::new(0));
    let listener = far.node("listener").unwrap();
    let (mut exec, _) = executor(&far);
    let sink = Arc::clone(&heard);
    let limit = IngressLimit::none().min_interval(Duration::from_millis(50));
    let topic = Topic::named("flood").ingress_limit(limit);
    exec.worker("flood")
        .subscribe(&listener, topic, qos, move |_: &Int32, _| {
            sink.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let start = Instant::now();
    let mut sent = 0;
    while sent < 1000 || heard.load(Ordering::SeqCst) < 2 {
        sent += i32::from(flood.publish(&Int32 { data: sent }).is_ok());
        std::thread::sleep(Duration::from_micros(500));
    }
    let heard = u128::try_from(heard.load(Ordering::SeqCst)).unwrap();
    let most = 1 + start.elapsed().as_millis() / 50;
    assert!(heard <= most, "{heard} of {sent}, {most} at most");
    running.stop();
}

#[test]
fn limits_out_of_range_are_refused() {
    let agent = TestAgent::start("127.0.0.1:0");
    let ctx = agent.context();
    let node = ctx.node("limits").unwrap();
    let none = IngressLimit::none();
    for (limit, field) in [
        (none.bytes_per_second(0), "ingress_limit.bytes_per_second"),
        (
            none.min_interval(Duration::from_micros(999)),
            "ingress_limit.min_interval",
        ),
        (
            none.min_interval(Duration::from_secs(66)),
            "ingress_limit.min_interval",
        ),
        (none.samples(0), "ingress_limit.samples"),
        (none.samples(u16::MAX), "ingress_limit.samples"),
        (
            none.duration(Duration::from_millis(999)),
            "ingress_limit.duration",
        ),
    ] {
        let (mut exec, _) = executor(&ctx);
        let topic = Topic::named("limited").ingress_limit(limit);
        let refused = exec
            .worker("w")
            .subscribe(&node, topic, Qos::best_effort(), |_: &Int32, _| ())
            .map(drop);
        match refused {
            Err(error @ Error::Parameter { .. }) => {
                assert!(error.to_string().contains(field), "{error}");
            }
            other => panic!("{limit:?}: {other:?}"),
        }
    }
}

#[test]
fn deadlines_lifespans_and_durability_are_accepted_and_the_agents_time_is_known() {
    let agent = TestAgent::start("127.0.0.1:0");
    let address = agent.address.to_string();
    let middleware = Xrce::udp_with(&address, XrceConfig::default()).unwrap();
    let qos = Qos::reliable()
        .transient_local()
        .deadline(Duration::from_millis(100))
        .lifespan(Duration::from_secs(30));
    middleware.create_writer(&spec("/qos", qos)).unwrap();
    middleware.create_reader(&spec("/qos", qos)).unwrap();
    let offset = middleware.agent_clock_offset().unwrap();
    assert!(offset.abs() < 1_000_000_000, "{offset} ns on one machine");
}

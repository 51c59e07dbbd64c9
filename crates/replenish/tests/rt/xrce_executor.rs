//! The executor over a real XRCE agent: a background worker in the session lock inherits, and a
//! lost agent neither hangs nor ends anything.

use crate::common::agent::TestAgent;
use crate::common::{cpu, eventually, executor};
use replenish::middleware::LinkState;
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{Budget, Context, Every, Policy, PublishError, Qos};
use replenish_os::{ThreadSpec, clock, spawn};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);
/// Seconds on a calm machine; for ever, if it does not happen.
const SOON: Duration = Duration::from_secs(20);

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("a_lost_agent_is_survived", lost_agent),
        rt_trial("d2_over_xrce_inherits", inheritance),
    ]
}

/// The agent stops: the link is down soon, publishing fails, the timers go on, stop
/// is prompt. It comes back: so do the samples.
fn lost_agent() {
    let _dog = watchdog("lost agent", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let (address, ctx) = (agent.address.to_string(), agent.context());
    let node = ctx.node("steady").unwrap();
    let publisher = node.publisher::<Int32>("beat", Qos::best_effort()).unwrap();
    let (beats, ticks) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(30_000 * MS);
    let (heard, ticked) = (Arc::clone(&beats), Arc::clone(&ticks));
    let beat = publisher.clone();
    exec.worker("steady")
        .timer(5 * MS, move |_| {
            ticked.fetch_add(1, Ordering::SeqCst);
            beat.publish(&Int32 { data: 1 }).ok();
        })
        .unwrap()
        .subscribe(&node, "beat", Qos::best_effort(), move |_: &Int32, _| {
            heard.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| beats.load(Ordering::SeqCst) > 10));

    drop(agent);
    let start = Instant::now();
    assert!(eventually(|| ctx.link() != LinkState::Up));
    assert!(start.elapsed() < SOON, "{:?}", start.elapsed());
    assert_eq!(
        publisher.publish(&Int32 { data: 2 }),
        Err(PublishError::LinkDown)
    );
    let before = ticks.load(Ordering::SeqCst);
    assert!(
        eventually(|| ticks.load(Ordering::SeqCst) > before + 10),
        "the timer goes on"
    );

    let agent = TestAgent::start(&address);
    let start = Instant::now();
    let before = beats.load(Ordering::SeqCst);
    assert!(eventually(|| beats.load(Ordering::SeqCst) > before + 10));
    assert!(start.elapsed() < SOON, "{:?}", start.elapsed());
    assert_eq!(ctx.link(), LinkState::Up);
    drop(agent);
    let start = Instant::now();
    assert!(running.stop().stuck.is_empty());
    assert!(start.elapsed() < SOON, "{:?}", start.elapsed());
}

/// D2 as in `real_time.rs`, with the session of the XRCE adapter as what is locked: a worker
/// without budget publishes 4 kB without end; a hog of middle priority keeps it from running; the
/// dispatcher needs the lock for a message from outside.
fn inheritance() {
    const ROUNDS: i32 = 20;
    let _dog = watchdog("inheritance over XRCE", LIMIT);
    let (cpu, agent) = (cpu(), TestAgent::start("127.0.0.1:0"));
    let config = XrceConfig {
        mtu: 8192,
        ..XrceConfig::default()
    };
    let ctx = Context::new(Xrce::udp_with(&agent.address.to_string(), config).unwrap());
    let outside = agent.context();
    let qos = Qos::best_effort().keep_last(1);
    let node = ctx.node("inside").unwrap();
    let bulk = node.publisher::<UInt8MultiArray>("bulk", qos).unwrap();
    let call = outside
        .node("outside")
        .unwrap()
        .publisher::<Int32>("call", qos)
        .unwrap();

    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(30_000 * MS);
    exec.dispatcher(Policy::fifo(90).unwrap())
        .dispatcher_cpu(cpu);
    let heard = Arc::new(AtomicI32::new(0));
    let latest = Arc::clone(&heard);
    exec.worker("high")
        .policy(Policy::fifo(80).unwrap())
        .cpu(cpu)
        .subscribe(&node, "call", qos, move |m: &Int32, _| {
            latest.store(m.data, Ordering::SeqCst);
        })
        .unwrap();
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(4096, 1).unwrap();
    exec.worker("background")
        .policy(Policy::fifo(60).unwrap())
        .budget(Budget::of(MS).every(10_000 * MS))
        .cpu(cpu)
        .timer(Every::period(MS).first_after(Duration::ZERO), move |cx| {
            while !cx.is_stopping() {
                bulk.publish(&payload).ok();
            }
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| running.usage("background").unwrap().low));

    for round in 1..=ROUNDS {
        let hogging = Arc::new(AtomicBool::new(false));
        let hog = {
            let (hogging, heard) = (Arc::clone(&hogging), Arc::clone(&heard));
            spawn(
                ThreadSpec::new("hog")
                    .policy(Policy::fifo(50).unwrap())
                    .cpu(cpu),
                move || {
                    hogging.store(true, Ordering::SeqCst);
                    let end = clock::thread_cpu() + 900_000_000;
                    while clock::thread_cpu() < end && heard.load(Ordering::SeqCst) != round {}
                    heard.load(Ordering::SeqCst) == round
                },
            )
        };
        while !hogging.load(Ordering::SeqCst) {
            std::thread::yield_now();
        }
        call.publish(&Int32 { data: round }).unwrap();
        assert!(
            hog.unwrap().join().unwrap(),
            "round {round}: the message waited until the hog was over"
        );
        std::thread::sleep(5 * MS); // the background worker gets into its lock again
    }
    assert!(running.stop().stuck.is_empty());
}

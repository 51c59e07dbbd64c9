//! After the start nothing allocates over XRCE either: not the dispatchers, not the workers, not
//! who publishes.

use crate::ALLOC;
use crate::common::agent::TestAgent;
use crate::common::{eventually, executor};
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{PublishError, Qos};
use replenish_testkit::alloc::exempt_this_thread;
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![trial("nothing_allocates_over_xrce", allocations)]
}

/// 10 000 small messages there and back and as many of 4 kB, reliable, by fragments.
fn allocations() {
    const MESSAGES: i32 = 10_000;
    let _dog = watchdog("allocations over XRCE", Duration::from_secs(120));
    let agent = TestAgent::start("127.0.0.1:0");
    let (ping_ctx, pong_ctx) = (agent.context(), agent.context());
    let qos = Qos::reliable().keep_all(8);
    let node = ping_ctx.node("ping").unwrap();
    let small = node.publisher::<Int32>("small", qos).unwrap();
    let large = node.publisher::<UInt8MultiArray>("large", qos).unwrap();
    let (answer, bytes) = (Arc::new(AtomicI32::new(-1)), Arc::new(AtomicU64::new(0)));

    let (mut ping, _) = executor(&ping_ctx);
    let heard = Arc::clone(&answer);
    ping.worker("answers")
        .subscribe(&node, "answer", qos, move |m: &Int32, _| {
            assert_eq!(heard.swap(m.data, Ordering::SeqCst) + 1, m.data, "in order");
        })
        .unwrap();
    let node = pong_ctx.node("pong").unwrap();
    let back = node.publisher::<Int32>("answer", qos).unwrap();
    let (mut pong, _) = executor(&pong_ctx);
    let sum = Arc::clone(&bytes);
    pong.worker("small")
        .subscribe(&node, "small", qos, move |m: &Int32, _| back.publish(m))
        .unwrap();
    pong.worker("large")
        .subscribe(&node, "large", qos, move |m: &UInt8MultiArray, _| {
            sum.fetch_add(m.data.len() as u64, Ordering::SeqCst);
        })
        .unwrap();
    let (ping, pong) = (ping.start().unwrap(), pong.start().unwrap());

    exempt_this_thread();
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(4096, 7).unwrap();
    let patient = |publish: &dyn Fn() -> Result<(), PublishError>| {
        while let Err(error) = publish() {
            assert_eq!(error, PublishError::Full);
            std::thread::sleep(Duration::from_micros(50));
        }
    };
    ALLOC.arm();
    for n in 0..MESSAGES {
        // No more under way than the readers have room for: they keep all.
        let behind = |n: i32| {
            let (small, large) = (answer.load(Ordering::SeqCst), bytes.load(Ordering::SeqCst));
            small + 4 < n || large + 4 * 4096 < 4096 * u64::try_from(n).unwrap()
        };
        while behind(n) {
            std::thread::sleep(Duration::from_micros(50));
        }
        patient(&|| small.publish(&Int32 { data: n }));
        patient(&|| large.publish(&payload));
    }
    let all = 4096 * u64::try_from(MESSAGES).unwrap();
    let done =
        || answer.load(Ordering::SeqCst) == MESSAGES - 1 && bytes.load(Ordering::SeqCst) == all;
    assert!(
        eventually(done),
        "{} answers",
        answer.load(Ordering::SeqCst) + 1
    );
    let counted = ALLOC.disarm();
    let (ping, pong) = (ping.stop(), pong.stop());
    assert_eq!(counted, 0, "{ping}\n{pong}");
}

//! After discovery nothing allocates in ROS 2 itself either, and the executor alone has threads.

use crate::ALLOC;
use crate::common::{eventually, executor};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{Context, PublishError, Qos};
use replenish_testkit::alloc::exempt_this_thread;
use replenish_testkit::domain::domain;
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![trial("nothing_allocates_over_rtps", allocations)]
}

fn threads() -> usize {
    std::fs::read_dir("/proc/self/task").unwrap().count()
}

/// 5000 small messages there and back between two participants, as many of 4 kB in fragments, and
/// as many that their worker receives itself.
fn allocations() {
    const MESSAGES: i32 = 5000;
    let _dog = watchdog("allocations over RTPS", Duration::from_secs(120));
    let config = RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    let before = threads();
    let [ping, pong] = [(); 2].map(|()| Context::new(Rtps::open(&config).unwrap()));
    let space = format!("p{}", std::process::id());
    let qos = Qos::reliable().keep_all(8);
    let node = ping.node(&format!("{space}/ping")).unwrap();
    let small = node.publisher::<Int32>("small", qos).unwrap();
    let large = node.publisher::<UInt8MultiArray>("large", qos).unwrap();
    let own = node.publisher::<Int32>("own", Qos::best_effort()).unwrap();
    let (answer, count) = (Arc::new(AtomicI32::new(-1)), Arc::new(AtomicI32::new(0)));
    let heard = Arc::clone(&answer);
    let (mut ping, _) = executor(&ping);
    ping.worker("answers")
        .subscribe(&node, "answer", qos, move |m: &Int32, _| {
            heard.store(m.data, Ordering::SeqCst);
        })
        .unwrap();
    let node = pong.node(&format!("{space}/pong")).unwrap();
    let back = node
        .publisher::<Int32>("answer", Qos::reliable().keep_last(100))
        .unwrap();
    let (mut pong, _) = executor(&pong);
    let sum = Arc::clone(&count);
    let (owned, itself) = (
        Arc::new(AtomicI32::new(-1)),
        Qos::best_effort().keep_last(100),
    );
    let last = Arc::clone(&owned);
    pong.worker("itself")
        .subscribe(&node, "own", itself, move |m: &Int32, _| {
            last.store(m.data, Ordering::SeqCst);
        })
        .unwrap();
    pong.worker("both")
        .subscribe(&node, "small", qos, move |m: &Int32, _| back.publish(m))
        .unwrap()
        .subscribe(&node, "large", qos, move |m: &UInt8MultiArray, _| {
            sum.fetch_add(i32::from(m.data.len() == 4096), Ordering::SeqCst);
        })
        .unwrap();
    assert_eq!(threads(), before, "a participant has no threads");
    let (ping, pong) = (ping.start().unwrap(), pong.start().unwrap());
    let executors = threads();
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(4096, 7).unwrap();
    // Until they know each other.
    let number = |data| Int32 { data };
    assert!(eventually(|| {
        small.publish(&number(-2)).ok();
        large.publish(&payload).ok();
        own.publish(&number(-2)).ok();
        std::thread::sleep(Duration::from_millis(20));
        let heard = [&answer, &owned].map(|last| last.load(Ordering::SeqCst));
        heard == [-2, -2] && count.load(Ordering::SeqCst) > 0
    }));
    // And until what they said on the way has come.
    assert!(eventually(|| {
        let now = count.load(Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(200));
        now == count.load(Ordering::SeqCst)
    }));
    let first = count.load(Ordering::SeqCst);
    exempt_this_thread();
    let patient = |publish: &dyn Fn() -> Result<(), PublishError>| {
        while let Err(error) = publish() {
            assert_eq!(error, PublishError::Full);
            std::thread::sleep(Duration::from_micros(50));
        }
    };
    ALLOC.arm();
    for n in 0..MESSAGES {
        patient(&|| small.publish(&number(n)));
        patient(&|| large.publish(&payload));
        own.publish(&number(n)).unwrap();
    }
    let all = || {
        (
            answer.load(Ordering::SeqCst),
            count.load(Ordering::SeqCst) - first,
        )
    };
    assert!(
        eventually(|| all() == (MESSAGES - 1, MESSAGES)),
        "{:?}",
        all()
    );
    assert!(eventually(|| owned.load(Ordering::SeqCst) == MESSAGES - 1));
    let counted = ALLOC.disarm();
    assert_eq!(threads(), executors, "nobody has made a thread");
    let (ping, pong) = (ping.stop(), pong.stop());
    assert_eq!(counted, 0, "{ping}\n{pong}");
}

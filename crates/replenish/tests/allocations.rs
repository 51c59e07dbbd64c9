//! After the start nothing allocates: not the dispatcher, not the workers, not the enforcer, over
//! 10 000 messages of 4 kB and as many small ones, with timers running.

use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{Budget, Context, Executor, Policy, Qos};
use replenish_testkit::alloc::{CountingAllocator, exempt_this_thread};
use replenish_testkit::harness::{rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

#[global_allocator]
static ALLOC: CountingAllocator = CountingAllocator::new();

const MESSAGES: u64 = 10_000;

fn main() {
    let trials = vec![
        trial("nothing_allocates_in_time_sharing", || {
            allocations(false);
        }),
        trial("nothing_allocates_without_threads", without_threads),
        rt_trial("nothing_allocates_under_budgets", || allocations(true)),
    ];
    // One after another: the counter sees every thread of the process.
    let mut arguments = libtest_mimic::Arguments::from_args();
    arguments.test_threads = Some(1);
    libtest_mimic::run(&arguments, trials).exit();
}

/// Ping-pong: a small message and a large one there, the small one back.
#[allow(clippy::unwrap_used, reason = "a test may panic")]
fn allocations(budgets: bool) {
    let _dog = watchdog("allocations", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_all(4);
    let small = node.publisher::<Int32>("small", qos).unwrap();
    let large = node.publisher::<UInt8MultiArray>("large", qos).unwrap();
    let back = node.publisher::<Int32>("back", qos).unwrap();
    let answers = Arc::new(AtomicU64::new(0));
    let bytes = Arc::new(AtomicU64::new(0));
    let ms = Duration::from_millis;

    let mut exec = Executor::new(&ctx);
    exec.no_ledger();
    let (count, sum) = (Arc::clone(&answers), Arc::clone(&bytes));
    let mut high = exec.worker("high");
    if budgets {
        high = high.budget(Budget::of(ms(2)).every(ms(10))).cpu(1);
    }
    high.subscribe(&node, "small", qos, move |m: &Int32, _| back.publish(m))
        .unwrap()
        .timer(ms(1), |_| ())
        .unwrap();
    let mut low = exec.worker("low");
    if budgets {
        low = low.policy(Policy::fifo(5).unwrap()).cpu(1);
    }
    low.subscribe(&node, "large", qos, move |m: &UInt8MultiArray, _| {
        sum.fetch_add(m.data.len() as u64, Ordering::Relaxed);
    })
    .unwrap();
    exec.worker("back")
        .subscribe(&node, "back", qos, move |_: &Int32, _| {
            count.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap();
    let running = exec.start().unwrap();

    exempt_this_thread();
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(4096, 7).unwrap();
    ALLOC.arm();
    let patience = Duration::from_micros(50);
    for n in 0..MESSAGES {
        // No more under way than every queue holds, so that every message gets its answer.
        while n >= answers.load(Ordering::Relaxed) + 4 {
            std::thread::sleep(patience);
        }
        let data = i32::try_from(n).unwrap();
        small.publish(&Int32 { data }).unwrap();
        while large.publish(&payload).is_err() {
            std::thread::sleep(patience);
        }
    }
    while answers.load(Ordering::Relaxed) < MESSAGES
        || bytes.load(Ordering::Relaxed) < MESSAGES * 4096
    {
        std::thread::sleep(patience);
    }
    let counted = ALLOC.disarm();
    let report = running.stop();
    assert_eq!(counted, 0, "{report}");
    assert!(report.thread("high").unwrap().usage.cpu_high > 0);
}

/// Every way to spin on the caller's thread.
#[allow(clippy::unwrap_used, reason = "a test may panic")]
fn without_threads() {
    let _dog = watchdog("allocations", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    let publisher = node.publisher::<Int32>("t", qos).unwrap();
    let mut exec = Executor::new(&ctx);
    exec.worker("w")
        .subscribe(&node, "t", qos, |_: &Int32, _| ())
        .unwrap()
        .timer(Duration::from_micros(300), |_| ())
        .unwrap();
    let mut local = exec.local().unwrap();
    ALLOC.arm();
    let mut callbacks = 0;
    for data in 0..200 {
        publisher.publish(&Int32 { data }).unwrap();
        callbacks += local.spin_some(Duration::from_millis(1)).callbacks;
        callbacks += local.spin_for(Duration::from_micros(200)).callbacks;
        callbacks += local.spin_one_period(Duration::from_micros(400)).callbacks;
    }
    assert_eq!(ALLOC.disarm(), 0);
    assert!(callbacks > 200);
    assert_eq!(local.stats("/n/sub:/t").unwrap().executed, 200);
}

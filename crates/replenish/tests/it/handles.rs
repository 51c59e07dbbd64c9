//! Guard conditions, timers that are changed while they run, raw bytes, the callback's context.

use crate::common::{Gate, eventually, executor, settles};
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::{
    Context, Error, Every, GuardCondition, Qos, RawType, RunningExecutor, SpinEnd, TimerHandle,
    Topic,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

type Text = BoundedString;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

fn executed(running: &RunningExecutor, id: &str) -> u64 {
    running.stats(id).unwrap().executed
}

/// rclc defect 7: no wake-up from other threads. 8 threads trigger 1000 times each.
#[test]
fn every_trigger_is_served_alone_or_together_with_others() {
    let _dog = watchdog("guard conditions", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let guard = GuardCondition::new();
    let served = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&served);
    exec.worker("w")
        .guard(&guard, move |cx| {
            count.fetch_add(1 + cx.skipped(), Ordering::Relaxed);
        })
        .unwrap();
    guard.trigger(); // before the start
    let running = exec.start().unwrap();
    let threads: Vec<_> = (0..8)
        .map(|_| {
            let guard = guard.clone();
            std::thread::spawn(move || (0..1000).for_each(|_| guard.trigger()))
        })
        .collect();
    threads.into_iter().for_each(|t| t.join().unwrap());
    assert!(eventually(|| served.load(Ordering::Relaxed) == 8001));
    let stats = running.stop().handle("w/guard:0").unwrap().stats;
    assert_eq!(stats.received, 8001);
    assert_eq!(stats.received, stats.executed + stats.skipped);
    // One callback may still be on its way out when the last trigger was counted.
    assert_eq!(
        stats.executed + stats.skipped,
        served.load(Ordering::Relaxed)
    );
}

/// Nothing turns while nothing is triggered: the worker gets no CPU time.
#[test]
fn an_idle_guard_costs_nothing_and_belongs_to_one_callback() {
    let _dog = watchdog("idle guard", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let guard = GuardCondition::new();
    let worker = exec.worker("w").guard(&guard, |_| ()).unwrap();
    let twice = worker.guard(&guard, |_| ()).map(drop).unwrap_err();
    assert!(matches!(twice, Error::Parameter { .. }), "{twice}");
    let running = exec.start().unwrap();
    assert!(settles(|| running.usage("w").unwrap().cpu_high));
}

#[test]
fn a_timer_is_started_cancelled_and_started_over() {
    let _dog = watchdog("timer handle", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (periodic, once) = (TimerHandle::new(), TimerHandle::new());
    exec.worker("w")
        .timer_with(&periodic, Every::period(MS).not_started(), |cx| {
            assert!(cx.due() <= cx.started() && cx.started() <= cx.now());
        })
        .unwrap()
        .timer_with(&once, Every::once(MS), |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| executed(&running, "w/timer:1") == 1));
    std::thread::sleep(20 * MS);
    assert_eq!(executed(&running, "w/timer:0"), 0, "not started");
    assert_eq!(executed(&running, "w/timer:1"), 1, "one shot");

    periodic.start();
    once.start();
    assert!(eventually(|| executed(&running, "w/timer:0") >= 3));
    assert!(eventually(|| executed(&running, "w/timer:1") == 2));
    periodic.cancel();
    assert!(eventually(|| periodic.next_release().is_none()));
    let after = executed(&running, "w/timer:0");
    std::thread::sleep(20 * MS);
    assert!(executed(&running, "w/timer:0") <= after + 1);
    assert!(periodic.set_period(Duration::ZERO).is_err());
}

#[test]
fn a_shorter_period_takes_effect_before_the_longer_one_has_passed() {
    let _dog = watchdog("set_period", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let timer = TimerHandle::new();
    let inside = timer.clone();
    exec.worker("w")
        .timer_with(&timer, Duration::from_secs(3600), move |cx| {
            inside.set_period(MS).unwrap(); // also from its own callback
            if cx.skipped() == 0 {
                inside.cancel();
            }
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert_eq!(executed(&running, "w/timer:0"), 0);
    timer.set_period(2 * MS).unwrap();
    assert!(eventually(|| executed(&running, "w/timer:0") > 0));
}

#[test]
fn raw_bytes_arrive_as_they_were_sent_and_with_their_context() {
    let _dog = watchdog("raw", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Text>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let got = Arc::new(Mutex::new(Vec::new()));
    let push = Arc::clone(&got);
    exec.worker("w")
        .subscribe_raw(
            &node,
            Topic::named("t").max_size(64),
            RawType::of::<Text>(),
            Qos::reliable(),
            move |bytes: &[u8], cx| {
                assert_eq!((cx.id(), cx.worker()), ("/n/sub:/t", "w"));
                assert!(cx.source_timestamp().unwrap() > 1_600_000_000_000_000_000);
                assert_eq!(cx.remaining_budget(), None);
                let sequence = cx.sequence().unwrap();
                push.lock().unwrap().push((sequence, bytes.to_vec()));
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let mut message = Text::default();
    message.data.push_str("hey").unwrap();
    out.publish(&message).unwrap();
    out.publish(&message).unwrap();
    assert!(eventually(|| got.lock().unwrap().len() == 2));
    let bytes = [&[4, 0, 0, 0][..], b"hey\0"].concat();
    assert_eq!(*got.lock().unwrap(), [(1, bytes.clone()), (2, bytes)]);
    drop(running);
}

/// The same while no executor takes them: in the middleware.
#[test]
fn the_newest_or_the_oldest_of_a_burst_survive_as_asked() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    for (topic, survive) in [
        (Topic::named("t"), [3, 4]),
        (Topic::named("t").keep_oldest(), [0, 1]),
    ] {
        let (mut exec, _) = executor(&ctx);
        let got = Arc::new(Mutex::new(Vec::new()));
        let push = Arc::clone(&got);
        let qos = Qos::reliable().keep_last(2);
        exec.worker("w")
            .subscribe(&node, topic, qos, move |m: &Int32, _| {
                push.lock().unwrap().push(m.data);
            })
            .unwrap();
        let mut local = exec.local().unwrap();
        for data in 0..5 {
            out.publish(&Int32 { data }).unwrap();
        }
        while local.spin_some(MS).end == SpinEnd::Worked {}
        assert_eq!(*got.lock().unwrap(), survive);
        let stats = local.report().handles[0].stats;
        assert_eq!(stats.lost + stats.dropped, 3);
    }
}

#[test]
fn the_newest_or_the_oldest_survive_as_asked() {
    let _dog = watchdog("drop policies", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let got = [(); 2].map(|()| Arc::new(Mutex::new(Vec::new())));
    let topics = [Topic::named("t"), Topic::named("t").keep_oldest()];
    for (i, topic) in topics.into_iter().enumerate() {
        let (pass, push) = (gate.clone(), Arc::clone(&got[i]));
        exec.worker(&format!("w{i}"))
            .subscribe(
                &node,
                topic,
                Qos::reliable().keep_last(2),
                move |m: &Int32, _| {
                    pass.pass();
                    push.lock().unwrap().push(m.data);
                },
            )
            .unwrap();
    }
    let running = exec.start().unwrap();
    let ids = ["/n/sub:/t", "/n/sub:/t#2"];
    let received = |n| {
        ids.iter()
            .all(|id| running.stats(id).unwrap().received == n)
    };
    let waiting = |n| ids.iter().all(|id| running.stats(id).unwrap().waiting == n);
    out.publish(&Int32 { data: 0 }).unwrap();
    assert!(eventually(|| received(1) && waiting(0)));
    for data in 1..=5 {
        out.publish(&Int32 { data }).unwrap();
        assert!(eventually(|| received(u64::try_from(data).unwrap() + 1)));
    }
    gate.open();
    assert!(eventually(|| got
        .iter()
        .all(|g| g.lock().unwrap().len() == 3)));
    assert_eq!(*got[0].lock().unwrap(), [0, 4, 5]);
    assert_eq!(*got[1].lock().unwrap(), [0, 1, 2]);
    for id in ids {
        assert_eq!(running.stats(id).unwrap().dropped, 3);
    }
}

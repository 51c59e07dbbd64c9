//! From middleware to callback: the paper's flaws D1, D3, D4 and D7, order, and bad samples.

use crate::common::scripted::Scripted;
use crate::common::{Gate, eventually, executor, settles};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Every, Qos, Topic};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Barrier, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);

fn int(data: i32) -> Int32 {
    Int32 { data }
}

/// D1: a lock held across the dispatcher's wait would keep every publisher waiting until something
/// arrives, and here nothing ever does: the dispatcher waits without a timeout.
#[test]
fn eight_workers_publish_at_once_while_the_dispatcher_idles_in_its_wait() {
    let _dog = watchdog("eight workers publish", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let start = Arc::new(Barrier::new(8));
    let sent = Arc::new(AtomicU64::new(0));
    for i in 0..8 {
        let out = node
            .publisher::<Int32>("nobody_listens", Qos::reliable())
            .unwrap();
        let (start, sent) = (Arc::clone(&start), Arc::clone(&sent));
        let mut first = true;
        exec.worker(&format!("w{i}"))
            .timer(Duration::from_millis(1), move |_| {
                if std::mem::take(&mut first) {
                    start.wait();
                    for n in 0..1000 {
                        out.publish(&int(n)).unwrap();
                        sent.fetch_add(1, Ordering::Relaxed);
                    }
                }
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    assert!(eventually(|| sent.load(Ordering::Relaxed) == 8000));
    let report = running.stop();
    // It slept through all of it: one wait that the stop ended, give or take a stale wake-up.
    assert!(report.dispatcher.rounds <= 2, "{:?}", report.dispatcher);
}

/// D3 and D4: what arrives while the worker is busy and its slots are taken stays in the
/// middleware without making the dispatcher spin, and moves on as soon as there is room.
#[test]
fn a_busy_handle_neither_spins_the_dispatcher_nor_loses_the_wake_up() {
    let _dog = watchdog("busy handle", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    let got = Arc::new(Mutex::new(Vec::new()));
    let push = Arc::clone(&got);
    exec.worker("w")
        .subscribe(
            &node,
            "t",
            Qos::reliable().keep_all(1),
            move |m: &Int32, _| {
                pass.pass();
                push.lock().unwrap().push(m.data);
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    out.publish(&int(1)).unwrap(); // to the callback
    gate.arrived();
    out.publish(&int(2)).unwrap(); // to the one slot
    assert!(eventually(
        || running.stats("/n/sub:/t").unwrap().waiting == 1
    ));
    out.publish(&int(3)).unwrap(); // stays in the middleware
    let rounds = || running.report().dispatcher.rounds;
    assert!(settles(rounds), "the dispatcher spins");

    gate.open(); // nothing else wakes the dispatcher now but the worker
    assert!(eventually(|| got.lock().unwrap().len() == 3));
    let report = running.stop();
    assert_eq!(*got.lock().unwrap(), [1, 2, 3]);
    let stats = report.handle("/n/sub:/t").unwrap().stats;
    assert_eq!((stats.received, stats.executed, stats.dropped), (3, 3, 0));
}

/// D4 again, on a middleware that keeps the samples of a busy reader buffered between others'.
#[test]
fn a_busy_handle_does_not_hold_up_the_others() {
    let _dog = watchdog("busy beside idle", LIMIT);
    let mw = Scripted::default();
    let ctx = Context::new(mw.clone());
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    exec.worker("busy")
        .subscribe(
            &node,
            "a",
            Qos::reliable().keep_all(1),
            move |_: &Int32, _| pass.pass(),
        )
        .unwrap();
    exec.worker("idle")
        .subscribe(&node, "b", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    for _ in 0..4 {
        mw.put(0, &1_i32.to_le_bytes());
    }
    gate.arrived();
    assert!(settles(|| running.report().dispatcher.rounds));
    assert!(mw.buffered() >= 2, "it took what it had no room for");
    for _ in 0..10 {
        mw.put(1, &2_i32.to_le_bytes());
    }
    assert!(eventually(
        || running.stats("/n/sub:/b").unwrap().executed == 10
    ));
    let rounds = || running.report().dispatcher.rounds;
    assert!(settles(rounds), "the dispatcher spins");
    gate.open();
    assert!(eventually(
        || running.stats("/n/sub:/a").unwrap().executed == 4
    ));
    running.stop();
}

/// D7: nothing disappears uncounted.
#[test]
fn keep_last_keeps_the_newest_and_counts_the_dropped() {
    let _dog = watchdog("keep last", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    let got = Arc::new(Mutex::new(Vec::new()));
    let push = Arc::clone(&got);
    exec.worker("w")
        .subscribe(
            &node,
            "t",
            Qos::best_effort().keep_last(2),
            move |m: &Int32, _| {
                pass.pass();
                push.lock().unwrap().push(m.data);
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let stats = || running.stats("/n/sub:/t").unwrap();
    out.publish(&int(0)).unwrap();
    gate.arrived();
    for n in 1..10 {
        out.publish(&int(n)).unwrap();
        assert!(eventually(
            || stats().received == u64::try_from(n).unwrap() + 1
        ));
    }
    assert_eq!(
        (stats().dropped, stats().waiting, stats().executed),
        (7, 2, 0)
    );
    gate.open();
    assert!(eventually(|| stats().executed == 3));
    let report = running.stop();
    assert_eq!(*got.lock().unwrap(), [0, 8, 9]);
    let stats = report.handle("/n/sub:/t").unwrap().stats;
    assert_eq!(stats.received, stats.executed + stats.dropped);
    assert!(stats.worst_latency > 0 && stats.cpu_high > 0);
}

#[test]
fn samples_that_are_too_large_or_no_message_are_dropped_counted_and_told() {
    let _dog = watchdog("bad samples", LIMIT);
    let mw = Scripted::default();
    let ctx = Context::new(mw.clone());
    let node = ctx.node("n").unwrap();
    let (mut exec, log) = executor(&ctx);
    let topic = Topic::named("t").max_size(4);
    exec.worker("w")
        .subscribe(&node, topic, Qos::reliable(), |m: &Int32, _| {
            assert_eq!(m.data, 7);
        })
        .unwrap();
    let running = exec.start().unwrap();
    mw.put(0, &[7, 0, 0, 0, 0]); // five bytes into four
    mw.put(0, &[7, 0]); // half an integer
    mw.put(0, &[7, 0, 0, 0]);
    mw.put(9, &[7, 0, 0, 0]); // a reader nobody has
    assert!(eventually(
        || running.stats("/n/sub:/t").unwrap().executed == 1
    ));
    let report = running.stop();
    let stats = report.handle("/n/sub:/t").unwrap().stats;
    assert_eq!(
        (stats.received, stats.oversize, stats.undecodable),
        (3, 1, 1)
    );
    assert!(
        log.has("sample of 5 bytes does not fit"),
        "{:?}",
        log.lines()
    );
    assert!(
        log.has("/n/sub:/t: sample cannot be decoded"),
        "{:?}",
        log.lines()
    );
}

#[test]
fn handles_of_a_worker_run_one_after_another_in_the_order_they_were_added() {
    let _dog = watchdog("order", LIMIT);
    let mw = Scripted::default();
    let ctx = Context::new(mw.clone());
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let got = Arc::new(Mutex::new(Vec::new()));
    // Holds the worker until everything is there.
    let (open, gate) = std::sync::mpsc::channel::<()>();
    let mut worker = exec
        .worker("w")
        .timer(Every::once(Duration::ZERO), move |_| {
            gate.recv().ok();
        })
        .unwrap();
    for topic in ["a", "b", "c"] {
        let got = Arc::clone(&got);
        worker = worker
            .subscribe(&node, topic, Qos::reliable(), move |m: &Int32, _| {
                got.lock().unwrap().push((topic, m.data));
            })
            .unwrap();
    }
    // Two of each in the wrong order.
    let (one, two) = (1_i32.to_le_bytes(), 2_i32.to_le_bytes());
    mw.put_all(&[
        (2, &one),
        (2, &two),
        (1, &one),
        (1, &two),
        (0, &one),
        (0, &two),
    ]);
    let running = exec.start().unwrap();
    let waiting = || {
        running
            .report()
            .handles
            .iter()
            .map(|h| h.stats.waiting)
            .sum::<u64>()
    };
    assert!(eventually(|| waiting() == 6));
    open.send(()).unwrap();
    assert!(eventually(|| got.lock().unwrap().len() == 6));
    running.stop();
    let want = [("a", 1), ("b", 1), ("c", 1), ("a", 2), ("b", 2), ("c", 2)];
    assert_eq!(*got.lock().unwrap(), want);
}

#[test]
fn a_failing_middleware_is_retried_at_a_bounded_rate_and_told_about() {
    let _dog = watchdog("failing middleware", LIMIT);
    let mw = Scripted::default();
    let ctx = Context::new(mw.clone());
    let node = ctx.node("n").unwrap();
    let (mut exec, log) = executor(&ctx);
    exec.worker("w")
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    let begun = Instant::now();
    mw.fail(true);
    assert!(eventually(|| running.report().dispatcher.failures >= 10));
    let failures = u128::from(running.report().dispatcher.failures);
    let most = 5 + begun.elapsed().as_millis() / 10;
    assert!(failures <= most, "{failures} failures, {most} at most");
    mw.fail(false);
    mw.put(0, &[1, 0, 0, 0]);
    assert!(eventually(
        || running.stats("/n/sub:/t").unwrap().executed == 1
    ));
    mw.link_down(true);
    assert!(eventually(|| log.lines().contains(&"link is down".into())));
    mw.link_down(false);
    assert!(eventually(|| log.has("link is up")));
    running.stop();
    assert!(log.has("middleware failed (1 times): the link is down"));
}

#[test]
fn waiting_samples_can_be_discarded_and_are_counted() {
    let _dog = watchdog("discard", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    exec.worker("w")
        .subscribe(
            &node,
            "t",
            Qos::reliable().keep_all(2),
            move |_: &Int32, _| pass.pass(),
        )
        .unwrap();
    let running = exec.start().unwrap();
    out.publish(&int(0)).unwrap();
    gate.arrived();
    for n in 1..5 {
        assert!(eventually(|| out.publish(&int(n)).is_ok()));
    }
    let stats = || running.stats("/n/sub:/t").unwrap();
    assert!(eventually(|| stats().waiting == 2));
    assert_eq!(running.discard_waiting(), 2);
    assert!(
        eventually(|| stats().waiting == 2),
        "the reader is back in the interest set"
    );
    gate.open();
    assert!(eventually(|| stats().executed == 3));
    let stats = running.stop().handle("/n/sub:/t").unwrap().stats;
    assert_eq!((stats.discarded, stats.received), (2, 5));
}

//! Lent messages beside everything else that an executor promises: panics, stops, handles that come
//! and go, deadlines, lifespans, chains, groups, triggers. Each time every message comes back.

use crate::common::{Gate, eventually, executor};
use crate::heard::Heard;
use crate::in_memory::Numbered;
use replenish::{
    Context, Executor, Group, HandleOptions, Node, OnMiss, Pool, Qos, QosEvent, Removal, Trigger,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
const SIZE: usize = 8;

struct Scene {
    ctx: Context,
    node: Node,
    pool: Pool<Numbered>,
    exec: Executor,
    heard: Arc<Mutex<Vec<u32>>>,
}

fn scene(qos: Qos) -> Scene {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Numbered>("t", qos).unwrap();
    Scene {
        pool: out.pool(SIZE, Numbered::default).unwrap(),
        exec: executor(&ctx).0,
        ctx,
        node,
        heard: Arc::default(),
    }
}

impl Scene {
    fn heard(&self) -> Vec<u32> {
        self.heard.lock().unwrap().clone()
    }

    fn all_free(&self) -> bool {
        eventually(|| self.pool.free() == SIZE)
    }
}

fn send(pool: &Pool<Numbered>, number: u32) {
    let mut message = pool.loan().unwrap();
    message.0 = number;
    message.publish().unwrap();
}

#[test]
fn a_callback_that_panics_gives_its_message_back_and_others_read_on() {
    let _dog = watchdog("a panic", LIMIT);
    let qos = Qos::reliable().keep_last(4);
    let mut scene = scene(qos);
    let note = Arc::clone(&scene.heard);
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    exec.worker("panics")
        .subscribe(&scene.node, "t", qos, |m: &Numbered, _| {
            assert!(m.0 != 2, "it is two");
        })
        .unwrap();
    exec.worker("reads")
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            note.lock().unwrap().push(m.0);
        })
        .unwrap();
    let running = exec.start().unwrap();
    for number in 1..=5 {
        send(&scene.pool, number);
        // The other worker may get the CPU later, and keeps four.
        let one = || running.stats("/n/sub:/t").unwrap().executed == 1;
        let read = || scene.heard().last() == Some(&number) && one();
        assert!(eventually(read));
    }
    assert!(scene.all_free(), "{:?}", scene.pool);
    let report = running.stop();
    let stats = |id: &str| report.handle(id).unwrap().stats;
    let panics = stats("/n/sub:/t");
    assert!(panics.panicked);
    assert_eq!((panics.executed, panics.discarded), (1, 3), "{panics:?}");
    assert_eq!(scene.heard(), [1, 2, 3, 4, 5]);
}

/// A stop while one message is read and three wait; what is published afterwards reaches nobody.
/// A handle to the executor is still there: once, the last message that waited was with it.
#[test]
fn a_stop_gives_back_what_is_read_and_what_waits() {
    let _dog = watchdog("a stop", LIMIT);
    let qos = Qos::reliable().keep_last(4);
    let mut scene = scene(qos);
    let gate = Gate::closed();
    let (held, note) = (gate.clone(), Arc::clone(&scene.heard));
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    exec.worker("w")
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            note.lock().unwrap().push(m.0);
            held.pass();
        })
        .unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    send(&scene.pool, 1);
    gate.arrived();
    (2..=4).for_each(|number| send(&scene.pool, number));
    assert_eq!(scene.pool.free(), SIZE - 4);
    let stop = running.stop_handle();
    let opener = std::thread::spawn(move || {
        stop.stop();
        std::thread::sleep(20 * MS);
        gate.open();
    });
    let report = running.stop();
    opener.join().unwrap();
    let stats = report.handle("/n/sub:/t").unwrap().stats;
    assert_eq!((stats.received, stats.executed, stats.waiting), (4, 1, 3));
    drop(report);
    assert!(scene.all_free(), "{:?}", scene.pool);
    send(&scene.pool, 5);
    assert_eq!((scene.heard(), scene.pool.free()), (vec![1], SIZE));
    drop(change);
}

/// The same without threads: a callback has kept a handle to the executor.
#[test]
fn an_executor_without_threads_gives_back_what_waits_at_its_end() {
    let qos = Qos::reliable().keep_last(4);
    let mut scene = scene(qos);
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    let kept = Arc::new(Mutex::new(None));
    let keep = Arc::clone(&kept);
    exec.worker("w")
        .subscribe(&scene.node, "t", qos, move |_: &Numbered, cx| {
            *keep.lock().unwrap() = cx.handle();
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    send(&scene.pool, 1);
    assert_eq!(local.spin_some(LIMIT).callbacks, 1);
    (2..=4).for_each(|number| send(&scene.pool, number));
    assert_eq!(scene.pool.free(), SIZE - 3);
    drop(local);
    assert!(kept.lock().unwrap().is_some());
    assert_eq!(scene.pool.free(), SIZE);
    send(&scene.pool, 5);
    assert_eq!(scene.pool.free(), SIZE);
}

/// Subscriptions come and go 100 times while messages are published; each hears only numbers that
/// rise, one that stays hears all, and every message comes back.
#[test]
fn subscriptions_come_and_go_while_messages_are_lent() {
    let _dog = watchdog("come and go", LIMIT);
    let qos = Qos::reliable().keep_last(1);
    let mut scene = scene(qos);
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    let last = Arc::new(AtomicU32::new(0));
    let note = Arc::clone(&last);
    exec.worker("w")
        .capacity(4)
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            assert!(note.swap(m.0, Ordering::SeqCst) < m.0);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    let publisher = {
        let (pool, stop) = (scene.pool.clone(), running.stop_handle());
        std::thread::spawn(move || {
            let mut number = 0;
            while !stop.is_stopping() {
                number += 1;
                send(&pool, number);
                std::thread::sleep(MS / 10);
            }
            number
        })
    };
    let mut got = 0;
    for _ in 0..100 {
        let worker = change.worker("w").unwrap();
        let mut before = 0;
        let rises = move |m: &Numbered, _: &replenish::CallbackContext<'_>| {
            assert!(std::mem::replace(&mut before, m.0) < m.0);
        };
        let id = worker.subscribe(&scene.node, "t", qos, rises).unwrap();
        std::thread::sleep(MS);
        let stats = change.remove(&id, Removal::Wait(LIMIT)).unwrap();
        let ends = stats.executed + stats.dropped + stats.discarded;
        assert_eq!((stats.received, stats.panicked), (ends, false), "{stats:?}");
        got += stats.executed;
    }
    let report = running.stop();
    let sent = publisher.join().unwrap();
    let stats = report.handle("/n/sub:/t").unwrap().stats;
    assert!(!stats.panicked && got > 0, "{stats:?}");
    let ends = stats.executed + stats.dropped + stats.waiting;
    assert_eq!(stats.received, ends, "{stats:?}");
    assert!(stats.received <= u64::from(sent), "{stats:?}");
    drop(report);
    assert!(scene.all_free(), "{:?}", scene.pool);
}

/// A callback misses its deadline: the next message is left out, and comes back.
#[test]
fn a_message_that_is_left_out_after_a_missed_deadline_comes_back() {
    let _dog = watchdog("left out", LIMIT);
    let qos = Qos::reliable().keep_last(4);
    let mut scene = scene(qos);
    let note = Arc::clone(&scene.heard);
    let gate = Gate::closed();
    let held = gate.clone();
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    exec.worker("w")
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            note.lock().unwrap().push(m.0);
            held.pass();
            if m.0 == 1 {
                std::thread::sleep(30 * MS);
            }
        })
        .unwrap()
        .options(HandleOptions::new().deadline(20 * MS, OnMiss::SkipNext));
    let running = exec.start().unwrap();
    send(&scene.pool, 1);
    gate.arrived();
    send(&scene.pool, 2);
    gate.open();
    let stats = || running.stats("/n/sub:/t").unwrap();
    assert!(eventually(|| stats().discarded == 1), "{:?}", stats());
    assert!(stats().deadline_misses >= 1);
    send(&scene.pool, 3);
    assert!(eventually(|| scene.heard().last() == Some(&3)));
    running.stop();
    assert_eq!(scene.heard(), [1, 3]);
    assert!(scene.all_free(), "{:?}", scene.pool);
}

#[test]
fn deadlines_of_the_topic_are_missed_without_messages_and_kept_with_them() {
    let _dog = watchdog("topic's deadline", LIMIT);
    let qos = Qos::reliable().keep_last(2).deadline(100 * MS);
    let mut scene = scene(qos);
    let events = Heard::default();
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    exec.worker("w")
        .subscribe(&scene.node, "t", qos, |_: &Numbered, _| ())
        .unwrap()
        .on_event("/n/sub:/t", events.sink())
        .unwrap();
    let running = exec.start().unwrap();
    let missed = || {
        let all = events.all();
        let mut missed = all.iter().filter_map(|event| match event {
            QosEvent::DeadlineMissed(count) => Some(count.total),
            _ => None,
        });
        missed.next_back().unwrap_or(0)
    };
    std::thread::sleep(250 * MS);
    assert_eq!(missed(), 0, "not before the first message");
    send(&scene.pool, 1);
    assert!(eventually(|| missed() >= 2), "{:?}", events.all());
    running.stop();
}

/// A message that waits for longer than its lifespan is not delivered, and comes back.
#[test]
fn a_message_whose_lifespan_is_over_comes_back_unread() {
    let _dog = watchdog("lifespan", LIMIT);
    let qos = Qos::reliable().keep_last(4).lifespan(50 * MS);
    let mut scene = scene(qos);
    let gate = Gate::closed();
    let (held, note) = (gate.clone(), Arc::clone(&scene.heard));
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    exec.worker("w")
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            held.pass();
            note.lock().unwrap().push(m.0);
        })
        .unwrap();
    let running = exec.start().unwrap();
    send(&scene.pool, 1);
    gate.arrived();
    (2..=3).for_each(|number| send(&scene.pool, number));
    std::thread::sleep(100 * MS);
    gate.open();
    let stats = || running.stats("/n/sub:/t").unwrap();
    assert!(eventually(|| stats().discarded == 2), "{:?}", stats());
    assert!(scene.all_free(), "{:?}", scene.pool);
    assert_eq!(scene.heard(), [1]);
    running.stop();
}

/// A timer lends, a filter reads and lends on, a sink reads: the chain ends as often as the sink
/// runs, and no callback of the group runs beside another one.
#[test]
fn chains_and_groups_hold_for_messages_that_are_lent() {
    let _dog = watchdog("chain and group", LIMIT);
    let qos = Qos::reliable().keep_last(4);
    let mut scene = scene(qos);
    let out = scene.node.publisher::<Numbered>("fine", qos).unwrap();
    let fine = out.pool(SIZE, Numbered::default).unwrap();
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    let group = Group::new("one at a time");
    let inside = Arc::new(AtomicU32::new(0));
    let alone = move || {
        let inside = Arc::clone(&inside);
        move || {
            assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0, "beside another");
            std::thread::sleep(MS / 5);
            inside.fetch_sub(1, Ordering::SeqCst);
        }
    };
    let (pool, mut number) = (scene.pool.clone(), 0);
    exec.worker("source")
        .timer(2 * MS, move |_| {
            number += 1;
            let mut message = pool.loan()?;
            message.0 = number;
            message.publish()
        })
        .unwrap();
    let (pool, visit) = (fine.clone(), alone());
    exec.worker("filter")
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            visit();
            let mut message = pool.loan()?;
            message.0 = m.0;
            message.publish()
        })
        .unwrap()
        .options(HandleOptions::new().group(&group));
    let visit = alone();
    exec.worker("sink")
        .subscribe(&scene.node, "fine", qos, move |_: &Numbered, _| visit())
        .unwrap()
        .options(HandleOptions::new().group(&group));
    let stages = ["source/timer:0", "/n/sub:/t", "/n/sub:/fine"];
    exec.chain("all", stages, None);
    let running = exec.start().unwrap();
    let enough = || running.report().chain("all").unwrap().ended >= 50;
    assert!(eventually(enough), "{}", running.report());
    let report = running.stop();
    let executed = |id: &str| report.handle(id).unwrap().stats.executed;
    let chain = report.chain("all").unwrap();
    assert_eq!(chain.begun, executed("source/timer:0"));
    assert_eq!(chain.ended, executed("/n/sub:/fine"));
    let panicked = report.handles.iter().any(|h| h.stats.panicked);
    assert!(!panicked, "{report}");
    drop(report);
    assert!(scene.all_free() && eventually(|| fine.free() == SIZE));
}

/// A round begins when both inputs are there, a lent one and an ordinary one. A reader that asks
/// for more than the publisher offers gets none of them.
#[test]
fn triggers_wait_for_lent_messages_and_quality_that_does_not_fit_keeps_them_away() {
    let _dog = watchdog("trigger", LIMIT);
    let qos = Qos::best_effort().keep_last(4);
    let mut scene = scene(qos);
    let plain = scene.node.publisher::<Numbered>("plain", qos).unwrap();
    let mut exec = std::mem::replace(&mut scene.exec, executor(&scene.ctx).0);
    let [lent, other] = [(); 2].map(|()| Arc::clone(&scene.heard));
    exec.worker("both")
        .trigger(Trigger::All)
        .subscribe(&scene.node, "t", qos, move |m: &Numbered, _| {
            lent.lock().unwrap().push(m.0);
        })
        .unwrap()
        .subscribe(&scene.node, "plain", qos, move |m: &Numbered, _| {
            other.lock().unwrap().push(m.0);
        })
        .unwrap();
    let strict = Qos::reliable().keep_last(4);
    exec.worker("strict")
        .subscribe(&scene.node, "t", strict, |_: &Numbered, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    for number in [1, 2] {
        send(&scene.pool, number);
        std::thread::sleep(30 * MS);
        assert_eq!(
            scene.heard().len() as u32,
            2 * (number - 1),
            "one is missing"
        );
        plain.publish(&Numbered(number)).unwrap();
        assert!(eventually(|| scene.heard().len() as u32 == 2 * number));
    }
    assert_eq!(scene.heard(), [1, 1, 2, 2]);
    let report = running.stop();
    let strict = report
        .handles
        .iter()
        .find(|h| h.worker == "strict")
        .unwrap();
    assert_eq!(strict.stats.received, 0, "{report}");
}

//! Handles that come and go while the executor runs.

use crate::common::{Gate, eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Error, GuardCondition, HandleId, Qos, Removal};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
const LONG: Removal = Removal::Wait(Duration::from_secs(30));

#[test]
fn handles_come_and_go_from_four_threads_and_nobody_else_is_disturbed() {
    let _dog = watchdog("add and remove", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let kept = Arc::new(Mutex::new(Vec::new()));
    let push = Arc::clone(&kept);
    let qos = Qos::reliable().keep_all(4);
    exec.worker("w")
        .capacity(5)
        .subscribe(&node, "t", qos, move |m: &Int32, _| {
            push.lock().unwrap().push(m.data);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    let changers: Vec<_> = (0..4)
        .map(|_| {
            let (change, node) = (change.clone(), node.clone());
            std::thread::spawn(move || {
                for _ in 0..50 {
                    let worker = change.worker("w").unwrap();
                    let id = worker
                        .subscribe(&node, "t", qos, |_: &Int32, _| ())
                        .unwrap();
                    let stats = change.remove(&id, LONG).unwrap();
                    assert_eq!(
                        stats.received,
                        stats.executed + stats.discarded + stats.dropped,
                        "{stats:?}"
                    );
                }
            })
        })
        .collect();
    for data in 0..1000 {
        while out.publish(&Int32 { data }).is_err() {
            std::thread::yield_now(); // a reader that keeps all had no room; others got it
        }
    }
    changers.into_iter().for_each(|t| t.join().unwrap());
    let all = |v: &Vec<i32>| v.last() == Some(&999);
    assert!(eventually(|| all(&kept.lock().unwrap())));
    let mut got = kept.lock().unwrap().clone();
    got.dedup(); // a publication that is tried again reaches those again that had room
    assert_eq!(got, (0..1000).collect::<Vec<_>>());
    assert_eq!(running.report().handles.len(), 1);
}

/// rclc defect 4: adding and removing inside a callback broke the loop that ran it.
#[test]
fn a_callback_adds_a_handle_and_removes_itself() {
    let _dog = watchdog("from a callback", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let runs = Arc::new(AtomicU64::new(0));
    let (count, added) = (Arc::clone(&runs), Arc::new(AtomicU64::new(0)));
    let more = Arc::clone(&added);
    exec.worker("w")
        .capacity(3)
        .timer(MS, move |cx| {
            count.fetch_add(1, Ordering::Relaxed);
            let change = cx.handle().unwrap();
            let more = Arc::clone(&more);
            let timer = change.worker("w").unwrap().timer(MS, move |_| {
                more.fetch_add(1, Ordering::Relaxed);
            });
            timer.unwrap();
            change.remove(cx.id(), LONG).unwrap(); // its own worker: does not wait
            assert!(change.remove(cx.id(), LONG).is_err());
        })
        .unwrap()
        .timer(MS, |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| added.load(Ordering::Relaxed) >= 3));
    assert_eq!(runs.load(Ordering::Relaxed), 1);
    let ids: Vec<String> = running.report().handles.into_iter().map(|h| h.id).collect();
    assert_eq!(ids, ["w/timer:1", "w/timer:2"]);
}

#[test]
fn who_has_waited_in_vain_may_cancel() {
    let _dog = watchdog("second removal", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (guard, gate) = (GuardCondition::new(), Gate::closed());
    gate.open();
    let arrives = gate.clone();
    exec.worker("w")
        .guard(&guard, move |cx| {
            arrives.pass();
            while !cx.is_cancelled() {
                std::thread::sleep(MS);
            }
        })
        .unwrap();
    let running = exec.start().unwrap();
    let (change, id) = (running.handle(), "w/guard:0");
    guard.trigger();
    gate.arrived();
    for _ in 0..2 {
        let waited = change.remove(id, Removal::Wait(MS));
        assert_eq!(waited, Err(Error::StillRunning(id.into())));
        assert!(running.report().handles.is_empty());
    }
    let stats = change
        .remove(id, Removal::Cancel(Duration::from_secs(30)))
        .unwrap();
    assert_eq!(stats.executed, 1);
    let gone = change.remove(id, LONG);
    assert_eq!(gone, Err(Error::UnknownHandle(id.into())));
}

#[test]
fn a_removal_waits_for_the_callback_or_cancels_it_or_does_neither() {
    let _dog = watchdog("removal", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let guards = [(); 3].map(|()| GuardCondition::new());
    let cancelled = Arc::new(AtomicBool::new(false));
    let was = Arc::clone(&cancelled);
    let (wait, detach) = (gate.clone(), gate.clone());
    exec.worker("a")
        .guard(&guards[0], move |_| wait.pass())
        .unwrap();
    exec.worker("b")
        .guard(&guards[1], move |_| detach.pass())
        .unwrap();
    exec.worker("c")
        .guard(&guards[2], move |cx| {
            while !cx.is_cancelled() {
                std::thread::sleep(MS);
            }
            assert!(!cx.is_stopping());
            was.store(true, Ordering::Relaxed);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    guards.iter().for_each(GuardCondition::trigger);
    let started = |id: &str| running.stats(id).unwrap().received == 1;
    assert!(eventually(|| ["a", "b", "c"]
        .iter()
        .all(|w| started(&format!("{w}/guard:0")))));

    change.remove("b/guard:0", Removal::Detach).unwrap();
    let late = change
        .remove("a/guard:0", Removal::Wait(20 * MS))
        .unwrap_err();
    assert_eq!(late, Error::StillRunning("a/guard:0".into()));
    let cancel = Removal::Cancel(Duration::from_secs(30));
    change.remove("c/guard:0", cancel).unwrap();
    assert!(cancelled.load(Ordering::Relaxed));
    gate.open();
    assert_eq!(change.remove("a/guard:0", LONG).unwrap().executed, 1);
    let unknown = change.remove("a/guard:0", LONG).unwrap_err();
    assert_eq!(unknown, Error::UnknownHandle("a/guard:0".into()));
    running.stop();
    let stopped = change.worker("a").unwrap().timer(MS, |_| ()).unwrap_err();
    assert_eq!(stopped, Error::Stopped);
}

#[test]
fn a_full_worker_says_how_many_handles_it_may_have() {
    let _dog = watchdog("capacity", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.worker("empty").capacity(2);
    exec.worker("fixed").timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    let add = |name: &str| change.worker(name).unwrap().timer(MS, |_| ());
    let full = add("fixed").unwrap_err().to_string();
    assert_eq!(full, "too many handles of worker \"fixed\": the limit is 1");
    let first = add("empty").unwrap();
    add("empty").unwrap();
    assert!(matches!(
        add("empty"),
        Err(Error::Capacity { limit: 2, .. })
    ));
    change.remove(&first, LONG).unwrap();
    add("empty").unwrap();
    assert!(matches!(change.worker("x"), Err(Error::UnknownWorker(_))));
}

/// Between two spins of an executor without threads nothing is carried out. When too many changes
/// wait the next is refused by name, and leaves nothing behind: it is possible after the next spin.
#[test]
fn a_change_too_many_is_refused_whole() {
    let _dog = watchdog("too many changes", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w").capacity(2000);
    let mut local = exec.local().unwrap();
    let change = local.handle();
    let qos = Qos::reliable().keep_last(1);
    let subscribe = || {
        let worker = change.worker("w").unwrap();
        worker.subscribe(&node, "t", qos, |_: &Int32, _| ())
    };
    let first: Vec<HandleId> = (0..400).map(|_| subscribe().unwrap()).collect();
    local.spin_some(Duration::ZERO);
    let remove = |id: &str| change.remove(id, Removal::Detach).map(drop);
    let second: Vec<HandleId> = (0..400).map(|_| subscribe().unwrap()).collect();
    first.iter().for_each(|id| remove(id).unwrap());
    second.iter().take(224).for_each(|id| remove(id).unwrap());
    let full = Error::Capacity {
        what: "handles that come and go at the same time".into(),
        limit: 1024,
    };
    let guard = GuardCondition::new();
    let guarded = || change.worker("w").unwrap().guard(&guard, |_| ());
    assert_eq!(guarded(), Err(full.clone()));
    assert_eq!(subscribe(), Err(full.clone()));
    assert_eq!(remove(&second[300]), Err(full));

    local.spin_some(Duration::ZERO);
    guarded().unwrap();
    subscribe().unwrap();
    remove(&second[300]).unwrap();
    out.publish(&Int32 { data: 1 }).unwrap();
    guard.trigger();
    let (left, mut ran) = (400 - 224, 0);
    while ran < left + 1 {
        ran += local.spin_some(LIMIT).callbacks;
    }
    assert_eq!(local.spin_some(Duration::ZERO).callbacks, 0);
    assert_eq!(ran, left + 1, "those that are left, and the guard");
}

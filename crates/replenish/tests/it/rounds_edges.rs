//! The edges of a worker's rounds: handles that have stopped or gone while a trigger waits for all,
//! conditions that are asked in vain, the order of handles that come later, the time of a trigger.

use crate::common::{Gate, eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, GuardCondition, HandleOptions, Qos, Removal, Trigger};
use replenish_os::clock;
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

#[test]
fn a_trigger_for_all_does_not_wait_for_a_handle_that_stopped_or_went() {
    let _dog = watchdog("trigger all without some", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (a, b, c) = (
        GuardCondition::new(),
        GuardCondition::new(),
        GuardCondition::new(),
    );
    let (runs, heard) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let (count, hear) = (Arc::clone(&runs), Arc::clone(&heard));
    let (mut exec, log) = executor(&ctx);
    exec.worker("w")
        .trigger(Trigger::All)
        .guard(&a, move |_| {
            count.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap()
        .guard(&b, |_| panic!("it stops here"))
        .unwrap()
        .guard(&c, |_| ())
        .unwrap()
        .subscribe(&node, "t", Qos::reliable(), move |_: &Int32, _| {
            hear.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let running = exec.start().unwrap();
    // The subscription is the last of a round: a trigger before that would be part of it.
    let ran = |n| eventually(|| [&runs, &heard].map(|c| c.load(Ordering::Relaxed)) == [n; 2]);
    [&a, &b, &c].iter().for_each(|guard| guard.trigger());
    out.publish(&Int32 { data: 0 }).unwrap();
    assert!(ran(1) && eventually(|| log.has("it stops here")));
    // `b` is left alone from now on: the others are all there are.
    a.trigger();
    c.trigger();
    out.publish(&Int32 { data: 1 }).unwrap();
    assert!(ran(2), "a handle that stopped is waited for");
    let wait = Removal::Wait(Duration::from_secs(30));
    running.handle().remove("w/guard:2", wait).unwrap();
    a.trigger();
    out.publish(&Int32 { data: 2 }).unwrap();
    assert!(ran(3), "a handle that went is waited for");
    // The subscription still is.
    a.trigger();
    std::thread::sleep(30 * MS);
    assert_eq!(runs.load(Ordering::Relaxed), 3);
}

#[test]
fn a_condition_is_asked_only_when_a_handle_is_ready() {
    let _dog = watchdog("custom trigger", LIMIT);
    let ctx = Context::in_process();
    let go = GuardCondition::new();
    let (mut exec, _) = executor(&ctx);
    let asked = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&asked);
    exec.worker("w")
        .every(MS)
        .trigger(Trigger::custom(move |handles| {
            note.lock().unwrap().push(handles.ready());
            true
        }))
        .guard(&go, |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| running.rounds("w").unwrap().served >= 20));
    assert_eq!(*asked.lock().unwrap(), [0_usize; 0], "nothing was ready");
    go.trigger();
    assert!(eventually(|| !asked.lock().unwrap().is_empty()));
    drop(running);
    assert_eq!(*asked.lock().unwrap(), [1]);
}

#[test]
fn handles_of_one_priority_run_in_the_order_they_came_also_later() {
    let _dog = watchdog("order of additions", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let guards: Vec<GuardCondition> = (0..6).map(|_| GuardCondition::new()).collect();
    let order = Arc::new(Mutex::new(String::new()));
    let (gate, hold) = (Gate::closed(), GuardCondition::new());
    let pass = gate.clone();
    let note = |name: char| {
        let order = Arc::clone(&order);
        move |_: &replenish::CallbackContext<'_>| order.lock().unwrap().push(name)
    };
    let with = |priority| HandleOptions::new().priority(priority);
    exec.worker("w")
        .capacity(7)
        .guard(&hold, move |_| pass.pass())
        .unwrap()
        .options(with(9))
        .guard(&guards[0], note('a'))
        .unwrap()
        .options(with(5))
        .guard(&guards[1], note('b'))
        .unwrap();
    let running = exec.start().unwrap();
    let handle = running.handle();
    for (at, name, priority) in [(2, 'c', 5), (3, 'd', 0), (4, 'e', 5), (5, 'f', 7)] {
        let worker = handle.worker("w").unwrap().options(with(priority));
        worker.guard(&guards[at], note(name)).unwrap();
    }
    // The worker has taken all of them over when it stands at the gate; then all are ready.
    hold.trigger();
    gate.arrived();
    guards.iter().rev().for_each(GuardCondition::trigger);
    gate.open();
    assert!(eventually(|| order.lock().unwrap().len() == 6));
    // By priority (7, 5, 0), and those of one as they came.
    assert_eq!(*order.lock().unwrap(), "facebd");
}

#[test]
fn a_guard_is_due_since_the_first_trigger_that_its_callback_serves() {
    let _dog = watchdog("due of a guard", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (guard, hold) = (GuardCondition::new(), GuardCondition::new());
    let (gate, served) = (Gate::closed(), Arc::new(Mutex::new(Vec::new())));
    let (pass, note) = (gate.clone(), Arc::clone(&served));
    exec.worker("w")
        .guard(&hold, move |_| pass.pass())
        .unwrap()
        .guard(&guard, move |cx| {
            note.lock().unwrap().push((cx.due(), cx.skipped()));
        })
        .unwrap();
    let running = exec.start().unwrap();
    hold.trigger();
    gate.arrived();
    let before = clock::monotonic();
    guard.trigger();
    let between = clock::monotonic();
    std::thread::sleep(5 * MS);
    guard.trigger();
    guard.trigger();
    gate.open();
    assert!(eventually(|| served.lock().unwrap().len() == 1));
    let (due, skipped) = served.lock().unwrap()[0];
    assert!((before..=between).contains(&due), "the first one counts");
    assert_eq!(skipped, 2);
    // The next one has a time of its own.
    let later = clock::monotonic();
    guard.trigger();
    assert!(eventually(|| served.lock().unwrap().len() == 2));
    let (due, skipped) = served.lock().unwrap()[1];
    assert!((later..=clock::monotonic()).contains(&due));
    assert_eq!(skipped, 0);
    drop(running);
}

//! Rounds without threads by rclc's two semantics, and rounds that need no input and no clock.

use crate::common::executor;
use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, Every, Executor, GuardCondition, Node, Publisher, Qos, Semantics,
    SpinEnd, Trigger, WorkerBuilder,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

type Seen = Arc<Mutex<Vec<(char, i32)>>>;

/// Topics `a` and `b`; the callback of `a` publishes one more than it got on `b`.
fn chain(semantics: Semantics) -> (Executor, Publisher<Int32>, Publisher<Int32>, Seen) {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let publisher = |topic| node.publisher::<Int32>(topic, Qos::reliable()).unwrap();
    let (a, b) = (publisher("a"), publisher("b"));
    let seen = Seen::default();
    let (first, second, next) = (Arc::clone(&seen), Arc::clone(&seen), b.clone());
    let (mut exec, _) = executor(&ctx);
    let qos = Qos::reliable().keep_last(1);
    exec.worker("w")
        .semantics(semantics)
        .subscribe(&node, "a", qos, move |m: &Int32, _| {
            first.lock().unwrap().push(('a', m.data));
            next.publish(&Int32 { data: m.data + 1 })
        })
        .unwrap()
        .subscribe(&node, "b", qos, move |m: &Int32, _| {
            second.lock().unwrap().push(('b', m.data));
        })
        .unwrap();
    (exec, a, b, seen)
}

/// rclc's test of its two semantics: `b` has an older sample when `a` publishes a newer one.
#[test]
fn a_callback_without_threads_sees_what_came_while_earlier_ones_ran() {
    let _dog = watchdog("semantics without threads", LIMIT);
    for (semantics, fresh) in [
        (Semantics::TakeThenExecute, true),
        (Semantics::LogicalExecutionTime, false),
    ] {
        let (exec, a, b, seen) = chain(semantics);
        let mut local = exec.local().unwrap();
        b.publish(&Int32 { data: 0 }).unwrap();
        a.publish(&Int32 { data: 10 }).unwrap();
        assert_eq!(local.spin_some(LIMIT).callbacks, 2);
        let b_sees = if fresh { 11 } else { 0 };
        assert_eq!(*seen.lock().unwrap(), [('a', 10), ('b', b_sees)]);
        let left = local.spin_some(Duration::ZERO).callbacks;
        assert_eq!(left, u64::from(!fresh), "the newer one is a round later");
        // Without an older one `b` is not due in the round of `a`.
        a.publish(&Int32 { data: 20 }).unwrap();
        assert_eq!(local.spin_some(LIMIT).callbacks, 1);
        assert_eq!(local.spin_some(Duration::ZERO).callbacks, 1);
        assert_eq!(seen.lock().unwrap().last(), Some(&('b', 21)));
        assert_eq!(local.spin_some(Duration::ZERO).callbacks, 0);
    }
}

/// A sample that is taken between two callbacks may ring a worker that had its turn.
#[test]
fn a_ring_between_two_callbacks_is_not_lost() {
    let _dog = watchdog("rings without threads", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (first, again) = (GuardCondition::new(), GuardCondition::new());
    let behind = GuardCondition::new();
    let served = Arc::new(AtomicU64::new(0));
    let (count, back) = (Arc::clone(&served), [again.clone(), behind.clone()]);
    exec.worker("early")
        .guard(&first, move |_| {
            count.fetch_add(1, Ordering::Relaxed);
            back.iter().for_each(GuardCondition::trigger);
        })
        .unwrap();
    let forth = first.clone();
    exec.worker("late")
        .guard(&again, move |_| {
            // From another thread: nothing but the ring tells of it.
            let forth = forth.clone();
            std::thread::spawn(move || forth.trigger()).join().unwrap();
        })
        .unwrap()
        .guard(&behind, |_| ()) // what came meanwhile is taken before this one
        .unwrap();
    let mut local = exec.local().unwrap();
    first.trigger();
    let served = || served.load(Ordering::Relaxed);
    let spun = local.spin_while(LIMIT, || served() < 200);
    assert_eq!(spun.end, SpinEnd::Worked);
}

fn always<'e>(node: &Node, exec: &'e mut Executor) -> (WorkerBuilder<'e>, Arc<Mutex<Vec<i32>>>) {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&seen);
    let callback = move |m: Option<&Int32>, _: &CallbackContext<'_>| {
        note.lock().unwrap().push(m.map_or(-1, |m| m.data));
    };
    let worker = exec.worker("w").trigger(Trigger::Always);
    let qos = Qos::reliable().keep_last(4);
    let worker = worker.subscribe_always(node, "a", qos, callback);
    (worker.unwrap(), seen)
}

#[test]
fn rounds_without_input_need_no_clock_where_the_program_spins() {
    let _dog = watchdog("always without threads", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("a", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let (_, seen) = always(&node, &mut exec);
    let mut local = exec.local().unwrap();
    let taken = || std::mem::take(&mut *seen.lock().unwrap());
    // One per period, and one per spin.
    for _ in 0..3 {
        let spun = local.spin_one_period(Every::period(MS));
        assert_eq!((spun.callbacks, spun.end), (1, SpinEnd::Worked));
    }
    assert_eq!(taken(), [-1, -1, -1]);
    out.publish(&Int32 { data: 7 }).unwrap();
    assert_eq!(local.spin_one_period(Every::period(MS)).callbacks, 1);
    assert_eq!(local.spin_some(LIMIT).callbacks, 1);
    assert_eq!(taken(), [7, -1]);
    // A longer spin begins one and ends with one, and sleeps between them.
    let spun = local.spin_for(100 * MS);
    assert_eq!(spun.end, SpinEnd::TimedOut);
    assert!((1..=3).contains(&spun.callbacks), "{spun:?}");
    assert!(taken().iter().all(|m| *m == -1));
    // The waiting samples are served, one after another.
    (1..=3).for_each(|data| out.publish(&Int32 { data }).unwrap());
    local.spin_for(100 * MS);
    let all = taken();
    assert_eq!(all.get(..3), Some(&[1, 2, 3][..]), "{all:?}");
    assert!(all.len() <= 5, "{all:?}");
}

#[test]
fn timers_of_unconditional_rounds_are_served_at_their_time() {
    let _dog = watchdog("always and a timer", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let (worker, seen) = always(&node, &mut exec);
    let ticks = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&ticks);
    // Long: two releases that are late are served in one round.
    let every = Every::period(100 * MS).overrun(replenish::Overrun::CatchUp);
    worker
        .timer(every, move |_| {
            count.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let ticks = || ticks.load(Ordering::Relaxed);
    assert_eq!(local.spin_while(LIMIT, || ticks() < 5).end, SpinEnd::Worked);
    // A round at the beginning, and one at each release, in which the subscription runs as well.
    let rounds = seen.lock().unwrap().len();
    assert!((6..=8).contains(&rounds), "{rounds}");
}

/// With threads nothing else begins rounds.
#[test]
fn always_without_a_clock_is_refused_with_threads() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    drop(always(&node, &mut exec));
    let error = exec.start().map(drop).unwrap_err().to_string();
    assert!(error.contains("with .every(…) only"), "{error}");
}

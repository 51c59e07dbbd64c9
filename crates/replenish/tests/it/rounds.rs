//! The start of a round, the order of its callbacks, and the input that they see.

use crate::common::{Gate, eventually, executor, settles};
use replenish::msg::std_msgs::Int32;
use replenish::{
    Context, Executor, GuardCondition, HandleOptions, Node, OnMiss, Overrun, Publisher, Qos,
    Semantics, Trigger, WorkerBuilder,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

struct Rig {
    node: Node,
    exec: Executor,
    a: Publisher<Int32>,
    b: Publisher<Int32>,
    seen: Arc<Mutex<Vec<(char, i32)>>>,
}

/// Topics `a` and `b`, and a list of what callbacks saw.
fn rig() -> Rig {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let publisher = |name| node.publisher::<Int32>(name, Qos::reliable()).unwrap();
    let (a, b) = (publisher("a"), publisher("b"));
    let (exec, _) = executor(&ctx);
    let seen = Arc::default();
    Rig {
        node,
        exec,
        a,
        b,
        seen,
    }
}

impl Rig {
    fn note(&self, topic: char) -> impl FnMut(&Int32, &replenish::CallbackContext<'_>) + use<> {
        let seen = Arc::clone(&self.seen);
        move |m: &Int32, _: &replenish::CallbackContext<'_>| {
            seen.lock().unwrap().push((topic, m.data));
        }
    }

    /// Worker `w` with a subscription to each topic.
    fn both(&mut self, trigger: Trigger) {
        let (a, b) = (self.note('a'), self.note('b'));
        self.exec
            .worker("w")
            .trigger(trigger)
            .subscribe(&self.node, "a", Qos::reliable(), a)
            .unwrap()
            .subscribe(&self.node, "b", Qos::reliable(), b)
            .unwrap();
    }
}

fn int(data: i32) -> Int32 {
    Int32 { data }
}

/// rclc defect 3: with trigger all, one or custom, input that is there and must wait made the
/// executor spin.
#[test]
fn a_trigger_waits_for_all_without_spinning() {
    let _dog = watchdog("trigger all", LIMIT);
    let custom = Trigger::custom(|handles| handles.ready() == 2 && handles.is_ready("/n/sub:/b"));
    for trigger in [Trigger::All, Trigger::one("/n/sub:/b"), custom] {
        let name = format!("{trigger:?}");
        let mut rig = rig();
        rig.both(trigger);
        // A release that is due must wait for the trigger as samples do.
        rig.exec.worker("idle").timer(MS, |_| ()).unwrap();
        let (a, b) = (rig.a.clone(), rig.b.clone());
        let seen = Arc::clone(&rig.seen);
        let running = rig.exec.start().unwrap();
        a.publish(&int(1)).unwrap();
        assert!(eventually(
            || running.stats("/n/sub:/a").unwrap().waiting == 1
        ));
        let cpu = || running.usage("w").unwrap().cpu_high;
        assert!(settles(cpu), "{name} spins");
        assert!(seen.lock().unwrap().is_empty(), "{name}");
        b.publish(&int(2)).unwrap();
        assert!(eventually(|| seen.lock().unwrap().len() == 2), "{name}");
        assert_eq!(*seen.lock().unwrap(), [('a', 1), ('b', 2)], "{name}");
    }
}

#[test]
fn a_due_timer_waits_for_the_rest_without_spinning() {
    let _dog = watchdog("trigger all, timer", LIMIT);
    let mut rig = rig();
    let a = rig.note('a');
    rig.exec
        .worker("w")
        .trigger(Trigger::All)
        .timer(2 * MS, |_| ())
        .unwrap()
        .subscribe(&rig.node, "a", Qos::reliable(), a)
        .unwrap();
    let out = rig.a.clone();
    let running = rig.exec.start().unwrap();
    let cpu = || running.usage("w").unwrap().cpu_high;
    assert!(settles(cpu), "it spins");
    let before = cpu();
    std::thread::sleep(500 * MS); // a thread that spins on a busy machine rests for 100 ms, too
    assert_eq!(cpu(), before, "it spins");
    out.publish(&int(1)).unwrap();
    let executed = |id: &str| running.stats(id).unwrap().executed;
    assert!(eventually(
        || executed("w/timer:0") == 1 && executed("/n/sub:/a") == 1
    ));
    assert!(running.stats("w/timer:0").unwrap().skipped >= 10);
}

#[test]
fn handles_run_by_priority_and_then_as_added() {
    let _dog = watchdog("order", LIMIT);
    let mut rig = rig();
    let (a, b) = (rig.note('a'), rig.note('b'));
    let (c, d) = (rig.note('c'), rig.note('d'));
    let qos = Qos::reliable();
    rig.exec
        .worker("w")
        .trigger(Trigger::All)
        .subscribe(&rig.node, "a", qos, a)
        .unwrap()
        .subscribe(&rig.node, "b", qos, b)
        .unwrap()
        .options(HandleOptions::new().priority(1))
        .subscribe(&rig.node, "a", qos, c)
        .unwrap()
        .options(HandleOptions::new().priority(9))
        .subscribe(&rig.node, "b", qos, d)
        .unwrap()
        .options(HandleOptions::new().priority(1));
    let (a, b, seen) = (rig.a.clone(), rig.b.clone(), Arc::clone(&rig.seen));
    let running = rig.exec.start().unwrap();
    a.publish(&int(0)).unwrap();
    b.publish(&int(0)).unwrap();
    assert!(eventually(|| seen.lock().unwrap().len() == 4));
    let order: Vec<char> = seen.lock().unwrap().iter().map(|(c, _)| *c).collect();
    assert_eq!(order, ['c', 'b', 'd', 'a']);
    drop(running);
}

/// The first callback publishes what the second would get; under LET it gets it a round later.
#[test]
fn logical_execution_time_shows_the_start_of_the_round() {
    let _dog = watchdog("LET", LIMIT);
    for semantics in [Semantics::TakeThenExecute, Semantics::LogicalExecutionTime] {
        let mut rig = rig();
        let (b, node) = (rig.b.clone(), rig.node.clone());
        let seen = Arc::clone(&rig.seen);
        let state = Arc::new(Mutex::new(0)); // the round, which the first callback publishes
        let sent = Arc::clone(&state);
        rig.exec
            .worker("w")
            .every(2 * MS)
            .trigger(Trigger::Always)
            .semantics(semantics)
            .timer(2 * MS, move |_| {
                let mut n = sent.lock().unwrap();
                *n += 1;
                // In every second round: a sample that comes late must not be in the way of all
                // that follow it.
                if *n % 2 == 1 {
                    b.publish(&int(*n))?;
                }
                // Long enough for it to arrive in this very round, in the end on any busy machine.
                let pause = MS / 2 * n.clamp(10, 400).unsigned_abs() / 10;
                drop(n);
                std::thread::sleep(pause);
                Ok::<(), replenish::PublishError>(())
            })
            .unwrap()
            .subscribe(&node, "b", Qos::reliable(), move |m: &Int32, _| {
                let now = *state.lock().unwrap();
                seen.lock().unwrap().push(('b', now - m.data));
            })
            .unwrap();
        let seen = Arc::clone(&rig.seen);
        let running = rig.exec.start().unwrap();
        let lets = semantics == Semantics::LogicalExecutionTime;
        assert!(eventually(|| {
            let seen = seen.lock().unwrap();
            seen.len() >= 10 && (lets || seen.iter().any(|(_, age)| *age == 0))
        }));
        drop(running);
        let ages: Vec<i32> = rig.seen.lock().unwrap().iter().map(|(_, a)| *a).collect();
        // All that was published in earlier rounds, nothing of this round.
        assert!(!lets || ages.iter().all(|a| *a >= 1), "{ages:?}");
    }
}

#[test]
fn the_output_barrier_holds_publications_until_the_round_ends() {
    let _dog = watchdog("barrier", LIMIT);
    let mut rig = rig();
    let (b, node) = (rig.b.clone(), rig.node.clone());
    let arrived = Arc::new(AtomicU64::new(0));
    let (count, early) = (Arc::clone(&arrived), Arc::new(AtomicU64::new(0)));
    let too_early = Arc::clone(&early);
    let go = GuardCondition::new();
    let full = Arc::new(AtomicU64::new(0));
    let overflow = Arc::clone(&full);
    rig.exec
        .worker("w")
        .output_barrier(2, 4)
        .guard(&go, move |cx| {
            cx.publish(&b, &int(1)).unwrap();
            cx.publish(&b, &int(2)).unwrap();
            overflow.fetch_add(
                u64::from(cx.publish(&b, &int(3)).is_err()),
                Ordering::Relaxed,
            );
            std::thread::sleep(20 * MS);
            too_early.fetch_add(arrived.load(Ordering::Relaxed), Ordering::Relaxed);
        })
        .unwrap();
    let note = rig.note('b');
    let mut note = note;
    rig.exec
        .worker("other")
        .subscribe(&node, "b", Qos::reliable(), move |m: &Int32, cx| {
            count.fetch_add(1, Ordering::Relaxed);
            note(m, cx);
        })
        .unwrap();
    let seen = Arc::clone(&rig.seen);
    let running = rig.exec.start().unwrap();
    go.trigger();
    assert!(eventually(|| seen.lock().unwrap().len() == 2));
    assert_eq!(*seen.lock().unwrap(), [('b', 1), ('b', 2)]);
    assert_eq!(early.load(Ordering::Relaxed), 0, "before the round ended");
    assert_eq!(full.load(Ordering::Relaxed), 1, "a full barrier says so");
    drop(running);
}

#[test]
fn always_runs_in_every_round_with_or_without_a_message() {
    let _dog = watchdog("always", LIMIT);
    let mut rig = rig();
    let (seen, node) = (Arc::clone(&rig.seen), rig.node.clone());
    let go = GuardCondition::new();
    rig.exec
        .worker("w")
        .subscribe_always(&node, "a", Qos::reliable(), move |m: Option<&Int32>, _| {
            seen.lock().unwrap().push(('a', m.map_or(-1, |m| m.data)));
        })
        .unwrap()
        .guard(&go, |_| ())
        .unwrap();
    let (a, seen) = (rig.a.clone(), Arc::clone(&rig.seen));
    let running = rig.exec.start().unwrap();
    for (n, data) in [(1, -1), (2, 7), (3, -1)] {
        match data {
            -1 => go.trigger(),
            _ => a.publish(&int(data)).unwrap(),
        }
        assert!(eventually(|| seen.lock().unwrap().len() == n));
    }
    assert_eq!(*seen.lock().unwrap(), [('a', -1), ('a', 7), ('a', -1)]);
    let stats = running.stop().handle("/n/sub:/a").unwrap().stats;
    assert_eq!((stats.executed, stats.without_input), (1, 2));
}

/// The worker that a deployment file moves such a handle to has no rule of its own.
#[test]
fn always_runs_in_every_round_of_the_worker_that_an_overlay_moves_it_to() {
    let _dog = watchdog("always moved", LIMIT);
    let mut rig = rig();
    let (node, go) = (rig.node.clone(), GuardCondition::new());
    let name = format!("replenish-always-{}.toml", std::process::id());
    let file = std::env::temp_dir().join(name);
    let text = "[[worker]]\nname = \"other\"\nhandles = [\"/n/sub:/a\", \"w/guard:0\"]\n";
    std::fs::write(&file, text).unwrap();
    rig.exec.overlay(&file);
    rig.exec
        .worker("w")
        .subscribe_always(&node, "a", Qos::reliable(), |_: Option<&Int32>, _| ())
        .unwrap()
        .guard(&go, |_| ())
        .unwrap();
    let running = rig.exec.start().unwrap();
    std::fs::remove_file(&file).unwrap();
    go.trigger();
    let without = || running.stats("/n/sub:/a").map_or(0, |s| s.without_input);
    assert!(eventually(|| without() == 1));
    assert_eq!(running.stop().handle("/n/sub:/a").unwrap().worker, "other");
}

#[test]
fn several_messages_per_round_if_asked_for() {
    let _dog = watchdog("batch", LIMIT);
    for (batch, order) in [(1, "abababaa"), (3, "aaabbbaa")] {
        let mut rig = rig();
        let (a, b) = (rig.note('a'), rig.note('b'));
        let qos = Qos::reliable().keep_last(10);
        // Holds the first round until all messages are there.
        let (gate, first) = (Gate::closed(), GuardCondition::new());
        let pass = gate.clone();
        first.trigger();
        rig.exec
            .worker("w")
            .messages_per_round(batch)
            .every(2 * MS)
            .guard(&first, move |_| pass.pass())
            .unwrap()
            .subscribe(&rig.node, "a", qos, a)
            .unwrap()
            .subscribe(&rig.node, "b", qos, b)
            .unwrap();
        let (a, b, seen) = (rig.a.clone(), rig.b.clone(), Arc::clone(&rig.seen));
        let running = rig.exec.start().unwrap();
        gate.arrived();
        (0..5).for_each(|n| a.publish(&int(n)).unwrap());
        (0..3).for_each(|n| b.publish(&int(n)).unwrap());
        let waiting = |id: &str| running.stats(id).unwrap().waiting;
        assert!(eventually(
            || (waiting("/n/sub:/a"), waiting("/n/sub:/b")) == (5, 3)
        ));
        gate.open();
        assert!(eventually(|| seen.lock().unwrap().len() == 8));
        let got: String = seen.lock().unwrap().iter().map(|(c, _)| *c).collect();
        assert_eq!(got, order);
        drop(running);
    }
}

#[test]
fn a_missed_deadline_is_counted_and_answered_as_asked() {
    let _dog = watchdog("deadlines", LIMIT);
    let slow = |_: &Int32, _: &replenish::CallbackContext<'_>| std::thread::sleep(3 * MS);
    let told = Arc::new(AtomicU64::new(0));
    let tell = Arc::clone(&told);
    let call = OnMiss::Call(Box::new(move |miss| {
        assert!(miss.lateness > 0 && miss.deadline == 1_000_000);
        tell.store(miss.count, Ordering::Relaxed);
    }));
    for (on_miss, runs, discards) in [(call, 4, 0), (OnMiss::SkipNext, 2, 2), (OnMiss::Stop, 1, 0)]
    {
        let stops = matches!(on_miss, OnMiss::Stop);
        let mut rig = rig();
        let qos = Qos::reliable().keep_last(10);
        rig.exec
            .worker("w")
            .subscribe(&rig.node, "a", qos, slow)
            .unwrap()
            .options(HandleOptions::new().deadline(MS, on_miss));
        let a = rig.a.clone();
        let running = rig.exec.start().unwrap();
        (0..4).for_each(|n| a.publish(&int(n)).unwrap());
        let stats = || running.stats("/n/sub:/a").unwrap();
        let done = || stats().executed + stats().discarded == 4;
        assert!(eventually(
            || done() || stops && running.stop_handle().is_stopping()
        ));
        let report = running.stop();
        let handle = report.handle("/n/sub:/a").unwrap();
        let stats = handle.stats;
        assert_eq!((stats.executed, stats.discarded), (runs, discards));
        assert_eq!(stats.deadline_misses, runs);
        assert_eq!(
            (handle.latency.count(), handle.response.count()),
            (runs, runs)
        );
        assert!(handle.response.percentile(50) >= 3_000_000);
    }
    assert_eq!(told.load(Ordering::Relaxed), 4);
}

#[test]
fn rules_that_contradict_each_other_are_refused_by_name() {
    let ctx = Context::in_process();
    let says = |describe: for<'a> fn(WorkerBuilder<'a>) -> WorkerBuilder<'a>| {
        let (mut exec, _) = executor(&ctx);
        describe(exec.worker("w").timer(MS, |_| ()).unwrap());
        exec.start().map(drop).unwrap_err().to_string()
    };
    let always = says(|w| w.trigger(Trigger::Always));
    assert!(
        always.contains("trigger = Always is not allowed"),
        "{always}"
    );
    let batch = says(|w| {
        w.semantics(Semantics::LogicalExecutionTime)
            .messages_per_round(2)
    });
    assert!(batch.contains("messages_per_round = 2"), "{batch}");
    let every = says(|w| w.every(Duration::ZERO));
    assert!(every.contains("every = 0"), "{every}");
    let capacity = says(|w| w.capacity(5000));
    assert!(
        capacity.contains("capacity = 5000 is not allowed: 1..=4096"),
        "{capacity}"
    );
}

/// Every release of the grid was served or is counted as skipped; with the other rules none is.
#[test]
fn rounds_that_are_overrun_are_counted_and_reported() {
    let _dog = watchdog("skipped rounds", LIMIT);
    for rule in [Overrun::Skip, Overrun::CatchUp, Overrun::Delay] {
        let mut rig = rig();
        let long = |_: &Int32, _: &replenish::CallbackContext<'_>| std::thread::sleep(30 * MS);
        rig.exec
            .worker("w")
            .every(replenish::Every::period(MS).overrun(rule))
            .subscribe(&rig.node, "a", Qos::reliable(), long)
            .unwrap();
        rig.exec.worker("other").timer(MS, |_| ()).unwrap();
        let (a, running) = (rig.a.clone(), rig.exec.start().unwrap());
        a.publish(&int(0)).unwrap();
        let rounds = || running.rounds("w").unwrap();
        assert!(eventually(
            || running.stats("/n/sub:/a").unwrap().executed == 1
        ));
        assert!(eventually(|| rounds().served >= 3
            && rounds().skipped >= 29
            || rule != Overrun::Skip));
        assert_eq!(running.rounds("other"), None, "no clock begins its rounds");
        let releases = |ns: u64| ns / 1_000_000;
        assert!(eventually(|| {
            let (before, counted) = (running.report().elapsed, rounds());
            let all = counted.served + counted.skipped;
            assert!(all <= releases(running.report().elapsed), "{counted:?}");
            all >= releases(before) || rule == Overrun::Delay // which moves the grid
        }));
        let report = running.stop();
        let [w] = &*report.rounds else {
            panic!("{:?}", report.rounds);
        };
        assert_eq!(
            (&*w.worker, w.stats.skipped > 0),
            ("w", rule == Overrun::Skip)
        );
        let (served, skipped) = (w.stats.served, w.stats.skipped);
        let line = format!("w: {served} rounds by the clock, {skipped} skipped\n");
        assert!(report.to_string().contains(&line), "{report}");
    }
}

#[test]
fn rounds_that_are_overrun_are_counted_without_threads() {
    let _dog = watchdog("skipped rounds", LIMIT);
    let mut rig = rig();
    rig.both(Trigger::Any);
    let worker = rig.exec.worker("clocked").every(MS);
    worker.timer(100 * MS, |_| ()).unwrap();
    let mut local = rig.exec.local().unwrap();
    std::thread::sleep(30 * MS);
    local.spin_for(MS);
    let rounds = local.rounds("clocked").unwrap();
    assert!(rounds.served >= 1 && rounds.skipped >= 29, "{rounds:?}");
    assert_eq!(local.rounds("w"), None);
    assert_eq!(local.report().rounds[0].stats, rounds);
}

//! Mutual exclusion across workers: one at a time within a group, side by side between groups, free
//! again after a panic, and no deadlock when callbacks call services of their own group.

use crate::common::fibonacci::{Fibonacci, Numbers, Order};
use crate::common::{Echo, eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{
    ActionOptions, CallbackContext, Context, GoalUpdate, Group, GuardCondition, HandleOptions,
    NewGoal, Qos, Removal,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// Counts who is inside, and the most that ever were.
#[derive(Clone, Default)]
struct Inside(Arc<(AtomicU64, AtomicU64)>);

impl Inside {
    fn visit(&self, time: Duration) {
        let now = self.0.0.fetch_add(1, Ordering::SeqCst) + 1;
        self.0.1.fetch_max(now, Ordering::SeqCst);
        std::thread::sleep(time);
        self.0.0.fetch_sub(1, Ordering::SeqCst);
    }

    fn most(&self) -> u64 {
        self.0.1.load(Ordering::SeqCst)
    }
}

/// Four workers with a timer each that sleeps in its callback: in one group, or in none.
fn most_at_once(group: Option<&Group>) -> u64 {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let inside = Inside::default();
    for name in ["a", "b", "c", "d"] {
        let inside = inside.clone();
        let mut handling = HandleOptions::new();
        if let Some(group) = group {
            handling = handling.group(group);
        }
        exec.worker(name)
            .timer(2 * MS, move |_| inside.visit(MS))
            .unwrap()
            .options(handling);
    }
    let running = exec.start().unwrap();
    let ids = ["a", "b", "c", "d"].map(|w| format!("{w}/timer:0"));
    let served = |id: &String| running.stats(id).unwrap().executed >= 10;
    assert!(eventually(|| ids.iter().all(served)), "nobody starves");
    running.stop();
    inside.most()
}

#[test]
fn callbacks_of_a_group_run_one_at_a_time() {
    let _dog = watchdog("group", LIMIT);
    assert_eq!(most_at_once(Some(&Group::new("one"))), 1);
    assert!(
        most_at_once(None) > 1,
        "without it they do run side by side"
    );
}

#[test]
fn a_panic_leaves_the_group_free() {
    let _dog = watchdog("group panic", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let group = Group::new("g");
    let boom = |_: &CallbackContext<'_>| -> () { panic!("on purpose") };
    exec.worker("bad")
        .timer(MS, boom)
        .unwrap()
        .options(HandleOptions::new().group(&group));
    exec.worker("good")
        .timer(MS, |_| ())
        .unwrap()
        .options(HandleOptions::new().group(&group));
    let running = exec.start().unwrap();
    assert!(eventually(|| running
        .stats("bad/timer:0")
        .unwrap()
        .panicked));
    let before = running.stats("good/timer:0").unwrap().executed;
    assert!(eventually(|| {
        running.stats("good/timer:0").unwrap().executed > before + 5
    }));
}

/// A callback asks a service whose server is in its own group: the answer comes as a callback of
/// its own, so no callback waits for itself.
#[test]
fn calling_a_service_of_ones_own_group_is_no_deadlock() {
    let _dog = watchdog("group service", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let group = Group::new("g");
    let inside = Inside::default();
    let client = node.client::<Echo>("echo", Qos::services(), LIMIT).unwrap();
    let handling = || HandleOptions::new().group(&group);
    let (serves, hears, asks, call) = (
        inside.clone(),
        inside.clone(),
        inside.clone(),
        client.clone(),
    );
    exec.worker("server")
        .serve::<Echo, _>(&node, "echo", Qos::services(), move |ask, answer, _| {
            serves.visit(MS);
            answer.data = ask.data;
        })
        .unwrap()
        .options(handling());
    let answered = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&answered);
    exec.worker("client")
        .replies(&client, move |reply, _| {
            hears.visit(MS);
            count.fetch_add(u64::from(reply.is_ok()), Ordering::Relaxed);
        })
        .unwrap()
        .options(handling())
        .timer(2 * MS, move |_| {
            asks.visit(MS);
            call.call(&Int32 { data: 1 }).map(drop)
        })
        .unwrap()
        .options(handling());
    let running = exec.start().unwrap();
    assert!(eventually(|| answered.load(Ordering::Relaxed) >= 20));
    running.stop();
    assert_eq!(inside.most(), 1);
}

/// One line names the waiting handle, the group and its holder; the duration is the machine's.
fn both_named(lines: &[String]) -> bool {
    lines.iter().any(|line| {
        line.starts_with("/n/srv:/echo: has waited ")
            && line.contains(" for group \"arm\", which client/timer:0")
    })
}

/// The misuse: a callback waits, by a channel, for one of its own group. The event and the handle's
/// own hook report that with the names of both; the waiting callback goes on when it can.
#[test]
fn who_waits_for_his_own_group_is_told_with_both_names() {
    let _dog = watchdog("group misuse", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, log) = executor(&ctx);
    let group = Group::new("arm").patience(20 * MS);
    let client = node.client::<Echo>("echo", Qos::services(), LIMIT).unwrap();
    let hooked = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&hooked);
    let counts = move |_: &replenish::Event<'_>| {
        count.fetch_add(1, Ordering::SeqCst);
    };
    exec.worker("server")
        .serve::<Echo, _>(&node, "echo", Qos::services(), |ask, answer, _| {
            answer.data = ask.data;
        })
        .unwrap()
        .options(HandleOptions::new().group(&group).on_error(counts));
    let (tell, answer) = std::sync::mpsc::sync_channel(1);
    let (call, seen) = (client.clone(), log.clone());
    exec.worker("replies")
        .replies(&client, move |reply, _| {
            tell.send(reply.unwrap().data).ok();
        })
        .unwrap();
    let told = Arc::new(AtomicU64::new(0));
    let note = Arc::clone(&told);
    exec.worker("client")
        .timer(replenish::Every::once(MS), move |_| {
            call.call(&Int32 { data: 1 }).unwrap();
            // For ever, were it not for what the test wants to see.
            while answer.recv_timeout(MS).is_err() && !both_named(&seen.lines()) {}
            note.store(u64::from(both_named(&seen.lines())), Ordering::SeqCst);
        })
        .unwrap()
        .options(HandleOptions::new().group(&group));
    let running = exec.start().unwrap();
    let served = || running.stats("/n/srv:/echo").unwrap().executed == 1;
    assert!(eventually(served), "{:?}", log.lines());
    assert_eq!(told.load(Ordering::SeqCst), 1, "{:?}", log.lines());
    assert!(hooked.load(Ordering::SeqCst) >= 1);
}

/// A callback of a group removes a handle of another worker: one of the group, or one that is in
/// none. Either way that worker may wait for the group, so the removal does not wait for it; in
/// both cases it goes on.
#[test]
fn removing_a_handle_from_a_callback_of_a_group_is_no_deadlock() {
    for id in ["other/guard:0", "other/timer:1"] {
        let _dog = watchdog("group removal", LIMIT);
        let ctx = Context::in_process();
        let (mut exec, _) = executor(&ctx);
        let group = Group::new("g");
        let guard = GuardCondition::new();
        let wake = guard.clone();
        exec.worker("other")
            .guard(&guard, |_| ())
            .unwrap()
            .options(HandleOptions::new().group(&group))
            .timer(MS, |_| ())
            .unwrap()
            .timer(LIMIT, |_| ())
            .unwrap();
        let removed = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&removed);
        exec.worker("w")
            .timer(replenish::Every::once(MS), move |cx| {
                wake.trigger(); // its callback waits for the group from now on
                std::thread::sleep(5 * MS);
                let change = cx.handle().unwrap();
                // Of the groups that callbacks are in, its own is known also without its own
                // handle.
                change.remove(cx.id(), Removal::Wait(LIMIT)).unwrap();
                let gone = change.remove(id, Removal::Wait(LIMIT));
                count.store(u64::from(gone.is_ok()), Ordering::SeqCst);
            })
            .unwrap()
            .options(HandleOptions::new().group(&group));
        let running = exec.start().unwrap();
        assert!(eventually(|| removed.load(Ordering::SeqCst) == 1), "{id}");
        let before = running.stats("other/timer:0").unwrap().executed;
        let goes_on = || running.stats("other/timer:0").unwrap().executed > before + 5;
        assert!(eventually(goes_on), "{id}");
        assert!(running.stats(id).is_none());
    }
}

/// Three workers whose callbacks remove a handle of the next one's at the same time: the last of
/// them does not wait, so all of them end.
#[test]
fn removals_in_a_circle_are_no_deadlock() {
    let _dog = watchdog("circle", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let all_in = Arc::new(std::sync::Barrier::new(3));
    let removed = Arc::new(AtomicU64::new(0));
    for (name, next) in [("a", "b"), ("b", "c"), ("c", "a")] {
        let (all_in, count) = (Arc::clone(&all_in), Arc::clone(&removed));
        exec.worker(name)
            .timer(LIMIT, |_| ())
            .unwrap()
            .timer(replenish::Every::once(MS), move |cx| {
                all_in.wait();
                let change = cx.handle().unwrap();
                let gone = change.remove(format!("{next}/timer:0"), Removal::Wait(LIMIT));
                count.fetch_add(u64::from(gone.is_ok()), Ordering::SeqCst);
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    assert!(eventually(|| removed.load(Ordering::SeqCst) == 3));
    for name in ["a", "b", "c"] {
        assert!(running.stats(&format!("{name}/timer:0")).is_none());
    }
}

/// A service that answers what it was asked.
/// An action's client has five handles and one callback: all of them are in the group that is asked
/// for once, and tell the one hook; the same while it runs.
#[test]
fn all_handles_of_an_action_are_in_the_group() {
    let _dog = watchdog("group of an action", LIMIT);
    for live in [false, true] {
        let ctx = Context::in_process();
        let node = ctx.node("n").unwrap();
        let (mut exec, _) = executor(&ctx);
        let (group, inside) = (Group::new("g"), Inside::default());
        let told = Arc::new(AtomicU64::new(0));
        let serve = |_: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
            let goal = new.accept()?;
            goal.feedback(&Numbers::default())?;
            goal.succeed(&Numbers::default())
        };
        let options = ActionOptions::goals(2);
        exec.worker("s")
            .serve_action(&node, "f", options, serve, |_, _| true)
            .unwrap();
        let visits = inside.clone();
        exec.worker("t")
            .timer(3 * MS, move |_| visits.visit(2 * MS))
            .unwrap()
            .options(HandleOptions::new().group(&group));
        let (visits, tell) = (inside.clone(), Arc::clone(&told));
        let follow = move |_, update: GoalUpdate<'_, Fibonacci>, _: &CallbackContext<'_>| {
            visits.visit(5 * MS);
            match update {
                GoalUpdate::Feedback(_) => Err("feedback"),
                GoalUpdate::Accepted(_) => Err("accepted"),
                GoalUpdate::Result(..) => Err("result"),
                _ => Ok(()),
            }
        };
        let handling = HandleOptions::new().group(&group).on_error(move |_| {
            tell.fetch_add(1, Ordering::SeqCst);
        });
        let client = node.action_client::<Fibonacci>("f", options).unwrap();
        let worker = exec.worker("c").capacity(5);
        let running = if live {
            let running = exec.start().unwrap();
            let change = running.handle();
            let worker = change.worker("c").unwrap().options(handling);
            worker.follow(&client, follow).unwrap();
            running
        } else {
            worker.follow(&client, follow).unwrap().options(handling);
            exec.start().unwrap()
        };
        client.send(&Order { order: 1 }).unwrap();
        let errors = || -> u64 {
            let report = running.report();
            report.handles.iter().map(|h| h.stats.errors).sum()
        };
        assert!(eventually(|| errors() == 3));
        assert_eq!(inside.most(), 1, "live: {live}");
        // The hook runs after the error is counted.
        let told = || told.load(Ordering::SeqCst) == 3;
        assert!(eventually(told), "live: {live}");
    }
}

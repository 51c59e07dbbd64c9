//! Async callbacks: they interleave on one worker, end with it, and are counted as callbacks.

use crate::common::fibonacci::{Fibonacci, Numbers, Order};
use crate::common::{Echo, Gate, eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{
    ActionClient, ActionOptions, CallError, Client, Context, Every, GoalError, GoalHandle,
    GoalState, NewGoal, NoReply, Qos, Removal, Responder, RunningGoal, Sleep, sleep, sleep_until,
};
use replenish_os::clock;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::task::Poll;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

type Lines = Arc<Mutex<Vec<String>>>;
/// Requests that wait for their replies.
type Open = Arc<Mutex<Vec<(i32, Responder<Echo>)>>>;

fn note(lines: &Lines, text: impl Into<String>) {
    lines.lock().unwrap().push(text.into());
}

fn number(data: i32) -> Int32 {
    Int32 { data }
}

/// A client of the service `name`, and the requests that the server has got and not answered.
fn held(exec: &mut replenish::Executor, ctx: &Context, name: &'static str) -> (Client<Echo>, Open) {
    let node = ctx.node("n").unwrap();
    let open = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&open);
    exec.worker(&format!("server of {name}"))
        .serve_later::<Echo, _, _>(&node, name, Qos::services(), move |request, to, _| {
            sink.lock().unwrap().push((request.data, to));
        })
        .unwrap();
    let client = node.client(name, Qos::services(), LIMIT).unwrap();
    (client, open)
}

/// Two callbacks of one worker wait at the same time; the one that waits holds up no other.
#[test]
fn callbacks_interleave_while_one_awaits() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let (client, open) = held(&mut exec, &ctx, "echo");
    let lines = Lines::default();
    let ticks = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&ticks);
    let mut worker = exec.worker("w").calls(&client).unwrap();
    for topic in ["a", "b"] {
        let (client, lines) = (client.clone(), Arc::clone(&lines));
        worker = worker
            .subscribe_async(&node, topic, Qos::reliable(), move |m: Int32| {
                let (client, lines) = (client.clone(), Arc::clone(&lines));
                async move {
                    note(&lines, format!("{topic} {} begins", m.data));
                    let reply = client.call_async(&m).await?;
                    note(&lines, format!("{topic} {} has {}", m.data, reply.data));
                    Ok::<(), CallError>(())
                }
            })
            .unwrap();
    }
    worker
        .timer(MS, move |_| {
            count.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let out = |topic| node.publisher::<Int32>(topic, Qos::reliable()).unwrap();
    let (a, b) = (out("a"), out("b"));
    a.publish(&number(1)).unwrap();
    a.publish(&number(2)).unwrap(); // waits in the subscription
    assert!(eventually(|| open.lock().unwrap().len() == 1));
    b.publish(&number(3)).unwrap();
    assert!(eventually(|| open.lock().unwrap().len() == 2));
    let before = ticks.load(Ordering::Relaxed);
    assert!(eventually(|| ticks.load(Ordering::Relaxed) > before + 5));
    let reply = |at: usize| {
        let (data, to) = open.lock().unwrap().remove(at);
        to.reply(&number(10 * data)).unwrap();
    };
    reply(1);
    assert!(eventually(|| lines.lock().unwrap().len() == 3));
    reply(0);
    assert!(eventually(|| lines.lock().unwrap().len() == 5));
    assert!(eventually(|| open.lock().unwrap().len() == 1));
    reply(0);
    assert!(eventually(|| lines.lock().unwrap().len() == 6));
    assert_eq!(
        *lines.lock().unwrap(),
        [
            "a 1 begins",
            "b 3 begins",
            "b 3 has 30",
            "a 1 has 10",
            "a 2 begins",
            "a 2 has 20"
        ]
    );
    // A poll is a callback: one to begin, one to end.
    let stats = running.stats("/n/sub:/a").unwrap();
    assert_eq!((stats.received, stats.executed), (2, 4));
    drop(running.stop());
}

#[test]
fn a_call_ends_at_its_limit_when_it_is_dropped_and_with_its_worker() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let (client, open) = held(&mut exec, &ctx, "echo");
    let short: Client<Echo> = node.client("nobody", Qos::services(), 20 * MS).unwrap();
    assert_eq!(
        client.call_blocking(&number(0), MS).unwrap_err(),
        CallError::NoCallback
    );
    let outcomes = Arc::new(Mutex::new(Vec::new()));
    let (sink, waits) = (Arc::clone(&outcomes), short.clone());
    exec.worker("w")
        .calls(&client)
        .unwrap()
        .calls(&short)
        .unwrap()
        .task(async move {
            let outcome = waits.call_async(&number(1)).await;
            sink.lock().unwrap().push(outcome.map(|n| n.data));
        })
        .unwrap();
    let running = exec.start().unwrap();
    let timed_out = Err(CallError::NoReply(NoReply::TimedOut));
    assert!(eventually(|| *outcomes.lock().unwrap() == [timed_out]));
    assert_eq!(
        client.call_blocking(&number(2), 20 * MS),
        Err(CallError::NoReply(NoReply::TimedOut))
    );
    // Its reply comes late, and reaches no other call.
    assert!(eventually(|| open.lock().unwrap().len() == 1));
    let (_, late) = open.lock().unwrap().pop().unwrap();
    std::thread::scope(|scope| {
        let next = scope.spawn(|| client.call_blocking(&number(3), LIMIT));
        assert!(eventually(|| open.lock().unwrap().len() == 1));
        late.reply(&number(2)).unwrap();
        let (data, to) = open.lock().unwrap().pop().unwrap();
        to.reply(&number(data)).unwrap();
        assert_eq!(next.join().unwrap().unwrap().data, 3);
    });
    // As many calls as the quality says, and places come back.
    for round in 1..=3 {
        let calls: Vec<_> = (0..10).map(|n| client.call_async(&number(n))).collect();
        let more = client.call_blocking(&number(99), LIMIT);
        assert_eq!(more.unwrap_err(), CallError::TooMany { limit: 10 });
        assert!(eventually(|| open.lock().unwrap().len() == 10));
        drop(calls);
        for (data, to) in open.lock().unwrap().drain(..) {
            to.reply(&number(data)).unwrap();
        }
        let late = 1 + 10 * round; // with the one above
        let stats = || running.stats("/n/cli:/echo").unwrap();
        assert!(eventually(|| stats().discarded == late), "{:?}", stats());
        assert_eq!(stats().executed, 1);
    }
    // A worker that ends wakes those who wait for it.
    std::thread::scope(|scope| {
        let last = scope.spawn(|| client.call_blocking(&number(4), LIMIT));
        assert!(eventually(|| open.lock().unwrap().len() == 1));
        drop(running.stop());
        assert_eq!(last.join().unwrap().unwrap_err(), CallError::Gone);
    });
}

/// Says so when it is dropped.
struct Dropped(Arc<AtomicBool>);

impl Drop for Dropped {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn a_future_is_dropped_when_it_is_done_and_with_its_worker() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (client, open) = held(&mut exec, &ctx, "echo");
    let flags = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let [done, stuck] = flags.clone().map(Dropped);
    let gate = Gate::closed();
    let (gate2, waits) = (gate.clone(), client.clone());
    exec.worker("w")
        .calls(&client)
        .unwrap()
        .task(async move {
            let _done = done;
            gate2.pass();
        })
        .unwrap()
        .task(async move {
            let _stuck = stuck;
            waits.call_async(&number(1)).await.map(|_| ())
        })
        .unwrap();
    let dropped = || flags.clone().map(|flag| flag.load(Ordering::Relaxed));
    let running = exec.start().unwrap();
    gate.arrived();
    assert_eq!(dropped(), [false, false]);
    gate.open();
    assert!(eventually(|| dropped() == [true, false]));
    assert!(eventually(|| open.lock().unwrap().len() == 1));
    drop(running.stop());
    assert_eq!(dropped(), [true, true]);
}

#[test]
fn services_and_timers_await_too() {
    let ctx = Context::in_process();
    let (mut exec, events) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let (inner, open) = held(&mut exec, &ctx, "inner");
    let outer: Client<Echo> = node.client("outer", Qos::services(), LIMIT).unwrap();
    let (through, slow) = (inner.clone(), inner.clone());
    let runs = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&runs);
    exec.worker("w")
        .calls(&inner)
        .unwrap()
        .serve_async::<Echo, _, _>(&node, "outer", Qos::services(), move |request: Int32| {
            let client = through.clone();
            async move {
                let inner = client.call_async(&request).await;
                number(inner.map_or(-1, |n| n.data + 1))
            }
        })
        .unwrap()
        .timer_async(Every::period(MS), move || {
            let (client, count) = (slow.clone(), Arc::clone(&count));
            async move {
                count.fetch_add(1, Ordering::Relaxed);
                client.call_async(&number(-5)).await?;
                Err::<(), CallError>(CallError::Gone)
            }
        })
        .unwrap();
    exec.worker("outer").calls(&outer).unwrap();
    let running = exec.start().unwrap();
    std::thread::scope(|scope| {
        let reply = scope.spawn(|| outer.call_blocking(&number(7), LIMIT));
        assert!(eventually(|| open.lock().unwrap().len() == 2));
        std::thread::sleep(20 * MS); // releases that find the timer's future in flight
        assert_eq!(runs.load(Ordering::Relaxed), 1);
        for (data, to) in open.lock().unwrap().drain(..) {
            to.reply(&number(data * 10)).unwrap();
        }
        assert_eq!(reply.join().unwrap().unwrap().data, 71);
    });
    assert!(eventually(|| runs.load(Ordering::Relaxed) == 2));
    drop(running.stop());
    // An error of a future is an error of its handle.
    assert!(events.has("w/timer:"), "{:?}", events.lines());
}

/// A goal's end is awaited, its cancelling too; a rejected one gives nothing.
#[test]
fn goals_are_awaited() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let options = ActionOptions::goals(4);
    let client = node.action_client::<Fibonacci>("fib", options).unwrap();
    let pursued: Arc<Mutex<Vec<GoalHandle<Fibonacci>>>> = Arc::default();
    let sink = Arc::clone(&pursued);
    exec.worker("server")
        .serve_action::<Fibonacci, _, _, _>(
            &node,
            "fib",
            options,
            move |goal: &Order, new: NewGoal<Fibonacci>, _| {
                if goal.order < 0 {
                    return new.reject();
                }
                sink.lock().unwrap().push(new.accept()?);
                Ok(())
            },
            |_, _| true,
        )
        .unwrap();
    let lines = Lines::default();
    let (sink, sends) = (Arc::clone(&lines), client.clone());
    exec.worker("client")
        .goals(&client)
        .unwrap()
        .task(async move {
            for order in [-1, 3, 4] {
                let goal = Order { order };
                let Some(goal) = sends.send_async(&goal).await? else {
                    note(&sink, format!("{order} is rejected"));
                    continue;
                };
                if order == 4 {
                    let answer = goal.cancel().await;
                    note(&sink, format!("cancel: {}", answer.unwrap().return_code));
                }
                let (state, result) = goal.result().await?;
                note(&sink, format!("{order} {state} {:?}", result.sequence));
            }
            Ok::<(), replenish::Lost>(())
        })
        .unwrap();
    let running = exec.start().unwrap();
    let next = || {
        assert!(eventually(|| !pursued.lock().unwrap().is_empty()));
        pursued.lock().unwrap().pop().unwrap()
    };
    let goal = next();
    let mut result = Numbers::default();
    result.sequence.extend([0, 1, 1]);
    goal.succeed(&result).unwrap();
    let goal = next();
    assert!(eventually(|| goal.state() == Some(GoalState::Canceling)));
    goal.canceled(&result).unwrap();
    assert!(eventually(|| lines.lock().unwrap().len() == 4));
    assert_eq!(
        *lines.lock().unwrap(),
        [
            "-1 is rejected",
            "3 succeeded [0, 1, 1]",
            "cancel: 0",
            "4 canceled [0, 1, 1]"
        ]
    );
    drop(running.stop());
}

/// A goal whose result is not awaited any more keeps no place of its client, whatever its limit.
#[test]
fn results_that_are_not_awaited_any_more_leave_room() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let pursued: Arc<Mutex<Vec<GoalHandle<Fibonacci>>>> = Arc::default();
    let sink = Arc::clone(&pursued);
    exec.worker("server")
        .serve_action::<Fibonacci, _, _, _>(
            &node,
            "fib",
            ActionOptions::goals(64),
            move |_: &Order, new: NewGoal<Fibonacci>, _| {
                sink.lock().unwrap().push(new.accept()?);
                Ok::<(), GoalError>(())
            },
            |_, _| true,
        )
        .unwrap();
    let options = ActionOptions::goals(1);
    let client = node.action_client::<Fibonacci>("fib", options).unwrap();
    let ended = Lines::default();
    let (sink, sends) = (Arc::clone(&ended), client.clone());
    exec.worker("client")
        .goals(&client)
        .unwrap()
        .task(async move {
            for _ in 0..11 {
                let goal = sends.send_async(&Order::default()).await?.unwrap();
                let mut result = goal.result();
                let polled = poll_fn(|cx| Poll::Ready(Pin::new(&mut result).poll(cx))).await;
                if let Poll::Ready(outcome) = polled {
                    note(&sink, format!("{outcome:?}"));
                }
            }
            let last = sends.send_async(&Order::default()).await?.unwrap();
            let (state, result) = last.result().await?;
            note(&sink, format!("{state} {:?}", result.sequence));
            Ok::<(), replenish::Lost>(())
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| pursued.lock().unwrap().len() == 12));
    let asked = || running.stats("/n/srv:/fib/_action/get_result").unwrap();
    assert!(eventually(|| asked().executed == 12), "{:?}", ended.lock());
    let results = || running.stats("/n/cli:/fib/_action/get_result").unwrap();
    let goals = std::mem::take(&mut *pursued.lock().unwrap());
    for (goal, n) in goals.iter().zip(1..) {
        let mut result = Numbers::default();
        result.sequence.extend([n]);
        goal.succeed(&result).unwrap();
        let came = || results().executed + results().discarded;
        assert!(eventually(|| came() == u64::try_from(n).unwrap()));
    }
    assert!(eventually(|| *ended.lock().unwrap() == ["succeeded [12]"]));
    assert_eq!((results().executed, results().discarded), (1, 11));
    drop(running.stop());
}

/// Its own limit is shorter than its client's: more calls in vain than the client has places.
#[test]
fn a_blocking_call_that_ends_without_reply_leaves_its_place() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (client, open) = held(&mut exec, &ctx, "echo");
    exec.worker("w").calls(&client).unwrap();
    let running = exec.start().unwrap();
    for n in 0..21 {
        let outcome = client.call_blocking(&number(n), MS);
        assert_eq!(outcome, Err(CallError::NoReply(NoReply::TimedOut)), "{n}");
        assert!(eventually(|| !open.lock().unwrap().is_empty()));
        if n < 11 {
            open.lock().unwrap().clear();
        } else {
            let (data, late) = open.lock().unwrap().pop().unwrap();
            late.reply(&number(data)).unwrap();
        }
    }
    let stats = || running.stats("/n/cli:/echo").unwrap();
    assert!(eventually(|| stats().discarded == 10), "{:?}", stats());
    std::thread::scope(|scope| {
        let last = scope.spawn(|| client.call_blocking(&number(99), LIMIT));
        assert!(eventually(|| open.lock().unwrap().len() == 1));
        let (data, to) = open.lock().unwrap().pop().unwrap();
        to.reply(&number(data)).unwrap();
        assert_eq!(last.join().unwrap().unwrap().data, 99);
    });
    assert_eq!(stats().executed, 1);
    drop(running.stop());
}

#[test]
fn a_handle_whose_future_waits_can_be_removed() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (client, open) = held(&mut exec, &ctx, "echo");
    let flag = Arc::new(AtomicBool::new(false));
    let (removed, waits) = (Dropped(flag.clone()), client.clone());
    let answered = Arc::new(AtomicU64::new(0));
    let (counts, asks) = (answered.clone(), client.clone());
    exec.worker("w")
        .calls(&client)
        .unwrap()
        .task(async move {
            let _removed = removed;
            waits.call_async(&number(1)).await.map(|_| ())
        })
        .unwrap()
        .task(async move {
            let reply = asks.call_async(&number(2)).await?;
            counts.store(u64::try_from(reply.data).unwrap_or(0), Ordering::Relaxed);
            Ok::<_, CallError>(())
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| open.lock().unwrap().len() == 2));
    let change = running.handle();
    change.remove("w/guard:0", Removal::Wait(LIMIT)).unwrap();
    assert!(flag.load(Ordering::Relaxed));
    // The reply that is not awaited any more, and the other one, arrive at the same worker.
    for (data, responder) in open.lock().unwrap().drain(..) {
        responder.reply(&number(data)).unwrap();
    }
    assert!(eventually(|| answered.load(Ordering::Relaxed) == 2));
    drop(running.stop());
}

/// Sleeps end at their times in their order, each with one poll, and the worker goes on meanwhile.
#[test]
fn sleeps_end_in_their_order_and_hold_up_nobody() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (lines, stop) = (Lines::default(), exec.stop_handle());
    // Far apart: sleeps that end in one standstill of the machine are polled in any order.
    let start = clock::monotonic() + 300_000_000;
    let mut worker = exec.worker("w").timer(MS, |_| ()).unwrap();
    for (name, offset) in [
        ("third", 800_000_000),
        ("first", 0),
        ("second", 400_000_000),
    ] {
        let (lines, stop) = (Arc::clone(&lines), stop.clone());
        let task = async move {
            for part in 1..=3 {
                let due = start + offset + part * 1_000_000;
                sleep_until(due).await;
                assert!(clock::monotonic() >= due);
            }
            note(&lines, name);
            if name == "third" {
                sleep(MS).await;
                sleep(Duration::ZERO).await; // is over when it is polled first
                stop.stop();
            }
        };
        worker = worker.task(task).unwrap();
    }
    let report = exec.spin().unwrap();
    assert_eq!(*lines.lock().unwrap(), ["first", "second", "third"]);
    let executed = |id: &str| report.handle(id).unwrap().stats.executed;
    assert!(executed("w/timer:0") > 10);
    // The first poll, and at most one for each sleep: two that are due at once take one.
    for (id, most) in [("w/guard:0", 5), ("w/guard:1", 4), ("w/guard:2", 4)] {
        assert!((2..=most).contains(&executed(id)), "{id}: {}", executed(id));
    }
}

/// More sleeps at a time than have a place, some of which are given up.
#[test]
fn a_future_may_have_many_sleeps() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (node, stop) = (ctx.node("n").unwrap(), exec.stop_handle());
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (served, count) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let seen = Arc::clone(&served);
    exec.worker("w")
        .subscribe_async(&node, "t", Qos::reliable(), move |_: Int32| {
            let (seen, count) = (Arc::clone(&seen), Arc::clone(&count));
            let stop = stop.clone();
            async move {
                let all: [Sleep; 20] = std::array::from_fn(|n| sleep(MS * (n as u32 + 1)));
                let mut all = all.map(Some);
                all[3] = None;
                poll_fn(|cx| {
                    let mut waits = false;
                    for place in &mut all {
                        if let Some(sleep) = place {
                            match Pin::new(sleep).poll(cx) {
                                Poll::Ready(()) => *place = None,
                                Poll::Pending => waits = true,
                            }
                        }
                    }
                    if waits {
                        Poll::Pending
                    } else {
                        Poll::Ready(())
                    }
                })
                .await;
                drop(sleep(LIMIT));
                if seen.fetch_add(1, Ordering::SeqCst) + 1 == 3 {
                    stop.stop();
                }
                count.fetch_add(1, Ordering::SeqCst);
            }
        })
        .unwrap();
    for n in 0..3 {
        out.publish(&number(n)).unwrap();
    }
    exec.spin().unwrap();
    assert_eq!(served.load(Ordering::SeqCst), 3);
}

/// A goal's order says how it ends; all are pursued at the same time on one worker.
#[test]
fn a_server_of_futures_ends_goals_as_they_say() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let client: ActionClient<Fibonacci> =
        node.action_client("fib", ActionOptions::goals(4)).unwrap();
    let server = exec
        .worker("server")
        .serve_action_async(
            &node,
            "fib",
            ActionOptions::goals(4),
            |goal: &Order| goal.order >= 0,
            |goal, running: RunningGoal<Fibonacci>| async move {
                let order = usize::try_from(goal.order).unwrap();
                let mut numbers = Numbers::begin();
                while numbers.sequence.len() < order && !running.is_canceling() {
                    sleep(MS).await;
                    if goal.order < 64 {
                        numbers.grow();
                    }
                    running.feedback(&numbers).map_err(|_| Numbers::default())?;
                }
                if goal.order == 13 {
                    Err(numbers)
                } else {
                    Ok(numbers)
                }
            },
        )
        .unwrap();
    let ids: Vec<_> = server.added().map(String::from).collect();
    assert_eq!(ids.len(), 5, "{ids:?}");
    assert_eq!(ids[0], "/n/task:/fib/_action/goals");
    let (lines, stop) = (Lines::default(), exec.stop_handle());
    let sink = Arc::clone(&lines);
    let sender = client.clone();
    let task = async move {
        let endless = sender
            .send_async(&Order { order: 100 })
            .await
            .unwrap()
            .unwrap();
        for order in [10, 13, -1, 1] {
            let line = match sender.send_async(&Order { order }).await.unwrap() {
                None => format!("{order} rejected"),
                Some(goal) => {
                    let (state, numbers) = goal.result().await.unwrap();
                    format!("{order} {state} {}", numbers.sequence.len())
                }
            };
            note(&sink, line);
        }
        endless.cancel().await.unwrap();
        let (state, numbers) = endless.result().await.unwrap();
        note(&sink, format!("{state} {}", numbers.sequence.len()));
        stop.stop();
    };
    exec.worker("w").goals(&client).unwrap().task(task).unwrap();
    exec.spin().unwrap();
    assert_eq!(
        *lines.lock().unwrap(),
        [
            "10 succeeded 10",
            "13 aborted 13",
            "-1 rejected",
            "1 succeeded 2",
            "canceled 2"
        ]
    );
}

/// The goals of a server that is removed are aborted: no client waits for ever.
#[test]
fn goals_end_with_the_server_that_pursues_them() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let client: ActionClient<Fibonacci> =
        node.action_client("fib", ActionOptions::goals(2)).unwrap();
    let pursue = |_, running: RunningGoal<Fibonacci>| async move {
        sleep(LIMIT).await;
        drop(running);
        Ok(Numbers::default())
    };
    let server = exec.worker("server").serve_action_async(
        &node,
        "fib",
        ActionOptions::goals(2),
        |_: &Order| true,
        pursue,
    );
    let task = server.unwrap().added().next().unwrap().to_string();
    let (begun, ended) = (Arc::new(AtomicBool::new(false)), Lines::default());
    let sender = client.clone();
    let (begins, lines) = (Arc::clone(&begun), Arc::clone(&ended));
    exec.worker("w")
        .goals(&client)
        .unwrap()
        .task(async move {
            let goal = sender
                .send_async(&Order { order: 1 })
                .await
                .unwrap()
                .unwrap();
            begins.store(true, Ordering::SeqCst);
            note(&lines, goal.result().await.unwrap().0.to_string());
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| begun.load(Ordering::SeqCst)));
    running
        .handle()
        .remove(&task, Removal::Wait(LIMIT))
        .unwrap();
    assert!(eventually(|| *ended.lock().unwrap() == ["aborted"]));
    running.stop();
}

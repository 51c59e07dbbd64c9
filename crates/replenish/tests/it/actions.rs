//! Actions: goals from acceptance to result, in one process and through the agent; cancelling,
//! limits, expiry; and the defects of rclc's actions (its busy loops, its single buffers).

use crate::common::fibonacci::{Fibonacci, Numbers, Order};
use crate::common::{eventually, executor, settles};
use replenish::msg::action::{FeedbackMessage, GetResult, GetResultRequest, GetResultResponse};
use replenish::msg::action_msgs::{CancelGoalResponse, GoalStatusArray};
use replenish::msg::builtin_interfaces::Time;
use replenish::{
    ActionClient, ActionOptions, CallError, CallbackContext, Client, Context, GoalError,
    GoalHandle, GoalId, GoalState, GoalUpdate, Lost, NewGoal, NoReply, Qos, RunningExecutor,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicI32, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// The messages that a client has heard, as text that can be compared.
type Heard = Arc<Mutex<Vec<(GoalId, String)>>>;

fn text(update: &GoalUpdate<'_, Fibonacci>) -> String {
    match update {
        GoalUpdate::Accepted(_) => "accepted".into(),
        GoalUpdate::Feedback(f) => format!("feedback {:?}", f.sequence),
        GoalUpdate::Result(state, r) => format!("{state} {:?}", r.sequence),
        GoalUpdate::Cancel(c) => format!("cancel {} {}", c.return_code, c.goals_canceling.len()),
        other => format!("{other:?}"),
    }
}

/// A client in an executor of its own.
fn follow(ctx: &Context, goals: usize) -> (ActionClient<Fibonacci>, Heard, RunningExecutor) {
    let node = ctx.node("client").unwrap();
    let options = ActionOptions::goals(goals).feedback_depth(100);
    let client: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    let unknown = client.send(&Order { order: 1 });
    assert_eq!(unknown, Err(CallError::NoCallback));
    let (mut exec, _) = executor(ctx);
    let heard = Heard::default();
    let note = Arc::clone(&heard);
    exec.worker("follow")
        .follow(&client, move |id, update, _| {
            note.lock().unwrap().push((id, text(&update)));
        })
        .unwrap();
    (client, heard, exec.start().unwrap())
}

/// The messages about one goal, its states left out: they come by another way, in no fixed order.
fn of(heard: &Heard, id: GoalId) -> Vec<String> {
    let heard = heard.lock().unwrap();
    let mine = heard
        .iter()
        .filter(|(i, t)| *i == id && !t.starts_with("State"));
    mine.map(|(_, t)| t.clone()).collect()
}

fn has(heard: &Heard, id: GoalId, what: &str) -> bool {
    heard
        .lock()
        .unwrap()
        .iter()
        .any(|(i, t)| *i == id && t.contains(what))
}

type Kept = Arc<Mutex<Vec<GoalHandle<Fibonacci>>>>;

/// A server in an executor of its own that keeps the goals it gets and is willing to cancel.
fn keep(ctx: &Context, options: ActionOptions) -> (Kept, RunningExecutor, crate::common::Log) {
    let node = ctx.node("server").unwrap();
    let (mut exec, log) = executor(ctx);
    let kept = Kept::default();
    let store = Arc::clone(&kept);
    let goal = move |_: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        new.accept().map(|goal| store.lock().unwrap().push(goal))
    };
    exec.worker("serve")
        .serve_action(&node, "fib", options, goal, |_, _| true)
        .unwrap();
    (kept, exec.start().unwrap(), log)
}

fn in_process() -> [Context; 2] {
    let bus = replenish::middleware::InProcessBus::new();
    [(); 2].map(|()| Context::new(bus.participant()))
}

type Pursued = (GoalHandle<Fibonacci>, usize, Numbers);

/// Three goals at once, step by step, by a timer of the same worker.
fn goals_are_pursued_side_by_side(server: &Context, client: &Context) {
    let _dog = watchdog("actions", LIMIT);
    let node = server.node("server").unwrap();
    let (mut exec, _) = executor(server);
    let goals: Arc<Mutex<Vec<Pursued>>> = Arc::default();
    let begun = Arc::clone(&goals);
    let goal = move |goal: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let Ok(order @ 2..=64) = usize::try_from(goal.order) else {
            return new.reject();
        };
        begun
            .lock()
            .unwrap()
            .push((new.accept()?, order, Numbers::begin()));
        Ok(())
    };
    exec.worker("serve")
        .serve_action(&node, "fib", ActionOptions::goals(4), goal, |_, _| true)
        .unwrap()
        .timer(5 * MS, move |_| {
            goals.lock().unwrap().retain_mut(|(goal, order, numbers)| {
                if numbers.sequence.len() >= *order {
                    goal.succeed(numbers).unwrap();
                    return false;
                }
                numbers.grow();
                goal.feedback(numbers).unwrap();
                true
            });
        })
        .unwrap();
    let serving = exec.start().unwrap();
    let (client, heard, _following) = follow(client, 4);
    let ids = [5, 9, 7, -1].map(|order| client.send(&Order { order }).unwrap());
    assert!(
        eventually(|| client.under_way() == 0),
        "{:?}",
        heard.lock().unwrap()
    );
    for (id, order) in ids.into_iter().zip([5, 9, 7]) {
        let mut expected = vec!["accepted".to_string()];
        expected.extend((3..=order).map(|n| format!("feedback {:?}", Numbers::of(n).sequence)));
        expected.push(format!("succeeded {:?}", Numbers::of(order).sequence));
        assert_eq!(of(&heard, id), expected);
    }
    assert_eq!(of(&heard, ids[3]), ["Rejected"]);
    let report = serving.stop();
    let served = |part: &str| {
        let id = format!("/server/srv:/fib/_action/{part}");
        let stats = &report.handle(&id).unwrap().stats;
        (stats.executed, stats.errors)
    };
    assert_eq!(
        (served("send_goal"), served("get_result")),
        ((4, 0), (3, 0))
    );
}

#[test]
fn goals_are_pursued_side_by_side_in_one_process() {
    let [server, client] = in_process();
    goals_are_pursued_side_by_side(&server, &client);
}

#[cfg(feature = "xrce")]
#[test]
fn goals_are_pursued_side_by_side_through_the_agent() {
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    goals_are_pursued_side_by_side(&agent.context(), &agent.context());
}

/// Over DDS-XRCE the feedback was reported before the acceptance in some runs.
#[test]
fn feedback_that_overtakes_the_acceptance_is_told_after_it() {
    let _dog = watchdog("feedback before acceptance", LIMIT);
    let [server, client] = in_process();
    let node = server.node("server").unwrap();
    let feedback = node
        .publisher::<FeedbackMessage<Fibonacci>>("fib/_action/feedback", Qos::reliable())
        .unwrap();
    let node = client.node("client").unwrap();
    let sender: ActionClient<Fibonacci> =
        node.action_client("fib", ActionOptions::goals(1)).unwrap();
    let heard = Heard::default();
    let note = Arc::clone(&heard);
    let (mut exec, _) = executor(&client);
    exec.worker("follow")
        .follow(&sender, move |id, update, _| {
            note.lock().unwrap().push((id, text(&update)));
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let goal_id = sender.send(&Order { order: 5 }).unwrap();
    let numbers = Numbers::begin();
    let message = FeedbackMessage {
        goal_id,
        feedback: numbers,
    };
    feedback.publish(&message).unwrap();
    local.spin_while(LIMIT, || !has(&heard, goal_id, "feedback"));
    assert_eq!(of(&heard, goal_id), ["accepted", "feedback [0, 1]"]);
}

/// rclc has one feedback buffer for all goals: here eight threads fill feedback at once.
/// A client that was busy finds feedback and the result together.
#[test]
fn a_result_does_not_overtake_the_feedback_before_it() {
    const STEPS: i32 = 8;
    let _dog = watchdog("result behind feedback", LIMIT);
    let [server, client] = in_process();
    let node = server.node("server").unwrap();
    let (mut exec, _) = executor(&server);
    let (go, gone) = std::sync::mpsc::channel::<()>();
    let gone = Mutex::new(Some(gone));
    let goal = move |_: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let (goal, gone) = (new.accept()?, gone.lock().unwrap().take().unwrap());
        std::thread::spawn(move || {
            gone.recv().unwrap();
            let mut numbers = Numbers::default();
            for n in 0..STEPS {
                numbers.sequence.clear();
                numbers.sequence.extend([n]);
                goal.feedback(&numbers).unwrap();
            }
            goal.succeed(&numbers).unwrap();
        });
        Ok::<(), GoalError>(())
    };
    exec.worker("serve")
        .serve_action(&node, "fib", ActionOptions::goals(1), goal, |_, _| true)
        .unwrap();
    let _serving = exec.start().unwrap();
    let node = client.node("client").unwrap();
    let options = ActionOptions::goals(1).feedback_depth(100);
    let sender: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    let heard = Heard::default();
    let note = Arc::clone(&heard);
    let (mut exec, _) = executor(&client);
    exec.worker("follow")
        .follow(&sender, move |id, update, _| {
            note.lock().unwrap().push((id, text(&update)));
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let id = sender.send(&Order { order: 1 }).unwrap();
    local.spin_while(LIMIT, || !has(&heard, id, "accepted"));
    local.spin_for(50 * MS); // the server gets to know that the result is asked for
    go.send(()).unwrap();
    std::thread::sleep(200 * MS); // busy elsewhere
    local.spin_while(LIMIT, || !has(&heard, id, "succeeded"));
    local.spin_for(50 * MS);
    let mut all = vec![String::from("accepted")];
    all.extend((0..STEPS).map(|n| format!("feedback [{n}]")));
    all.push(format!("succeeded [{}]", STEPS - 1));
    assert_eq!(of(&heard, id), all);
}

#[test]
fn goals_of_many_threads_keep_their_feedback_and_results_apart() {
    const GOALS: usize = 8;
    const STEPS: i32 = 50;
    let _dog = watchdog("many threads", LIMIT);
    let [server, client] = in_process();
    let node = server.node("server").unwrap();
    let (mut exec, _) = executor(&server);
    let orders: Arc<Mutex<Vec<(GoalId, i32, i32)>>> = Arc::default();
    let known = Arc::clone(&orders);
    let goal = move |goal: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let (goal, order) = (new.accept()?, goal.order);
        let known = Arc::clone(&known);
        std::thread::spawn(move || {
            let mut numbers = Numbers::default();
            for n in 0..STEPS {
                numbers.sequence.clear();
                numbers.sequence.extend([order; 60]);
                numbers.sequence[0] = n;
                goal.feedback(&numbers).unwrap();
                std::thread::sleep(MS / 10);
            }
            // The middleware may bring the result before feedback that it has had for longer.
            let all = |(_, o, heard): &(GoalId, i32, i32)| *o == order && *heard == STEPS;
            let heard = eventually(|| known.lock().unwrap().iter().any(all));
            assert!(heard, "all feedback");
            goal.succeed(&numbers).unwrap();
        });
        Ok::<(), GoalError>(())
    };
    exec.worker("serve")
        .serve_action(&node, "fib", ActionOptions::goals(GOALS), goal, |_, _| true)
        .unwrap();
    let _serving = exec.start().unwrap();
    let node = client.node("client").unwrap();
    let options = ActionOptions::goals(GOALS).feedback_depth(4096);
    let sender: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    let (feedback, results) = (Arc::new(AtomicI32::new(0)), Arc::new(AtomicUsize::new(0)));
    let (heard, ended) = (Arc::clone(&feedback), Arc::clone(&results));
    let known = Arc::clone(&orders);
    let (mut exec, _) = executor(&client);
    exec.worker("follow")
        .follow(&sender, move |id, update, _| {
            let mut known = known.lock().unwrap();
            let (_, order, next) = known.iter_mut().find(|(i, ..)| *i == id).unwrap();
            let check = |numbers: &Numbers, n: i32| {
                assert_eq!(numbers.sequence[0], n, "in order");
                assert!(
                    numbers.sequence[1..].iter().all(|n| n == order),
                    "of its goal"
                );
            };
            match update {
                GoalUpdate::Feedback(numbers) => {
                    check(numbers, *next);
                    *next += 1;
                    heard.fetch_add(1, Ordering::SeqCst);
                }
                GoalUpdate::Result(GoalState::Succeeded, numbers) => {
                    check(numbers, STEPS - 1);
                    ended.fetch_add(1, Ordering::SeqCst);
                }
                _ => {}
            }
        })
        .unwrap();
    let following = exec.start().unwrap();
    for order in 100..100 + i32::try_from(GOALS).unwrap() {
        let mut orders = orders.lock().unwrap();
        let id = sender.send(&Order { order }).unwrap();
        orders.push((id, order, 0));
    }
    let all = STEPS * i32::try_from(GOALS).unwrap();
    let count = || {
        (
            feedback.load(Ordering::SeqCst),
            results.load(Ordering::SeqCst),
        )
    };
    assert!(eventually(|| count().1 == GOALS), "{:?}", count());
    assert_eq!(count(), (all, GOALS));
    assert!(following.stop().handles.iter().all(|h| !h.stats.panicked));
}

#[test]
fn goals_are_canceled_one_all_or_until_a_time() {
    let _dog = watchdog("cancel", LIMIT);
    let [server, client] = in_process();
    let (kept, _serving, _) = keep(&server, ActionOptions::goals(8));
    let (client, heard, _following) = follow(&client, 8);
    let send = || {
        let id = client.send(&Order::default()).unwrap();
        assert!(eventually(|| has(&heard, id, "accepted")));
        id
    };
    let canceling = || {
        let kept = kept.lock().unwrap();
        let canceling = kept.iter().filter(|goal| goal.is_canceling());
        canceling.map(GoalHandle::id).collect::<Vec<_>>()
    };
    let (one, two) = (send(), send());
    assert_eq!(
        kept.lock().unwrap()[0].canceled(&Numbers::default()),
        Err(GoalError::State {
            event: replenish::GoalEvent::Canceled,
            state: GoalState::Executing,
        }),
        "nobody wants it to"
    );
    client.cancel(two).unwrap();
    assert!(eventually(|| has(&heard, two, "cancel 0 1")));
    assert_eq!(canceling(), [two]);
    assert!(eventually(|| has(&heard, two, "State(canceling)")));
    let second = kept.lock().unwrap().pop().unwrap();
    second.canceled(&Numbers::of(3)).unwrap();
    assert!(eventually(|| has(&heard, two, "canceled [0, 1, 1]")));
    client.cancel(two).unwrap();
    let ended = format!("cancel {} 0", CancelGoalResponse::ERROR_GOAL_TERMINATED);
    assert!(eventually(|| has(&heard, two, &ended)));
    assert!(
        second.feedback(&Numbers::default()).is_err(),
        "it has ended"
    );

    let until = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap();
    let stamp = Time {
        sec: i32::try_from(until.as_secs()).unwrap(),
        nanosec: until.subsec_nanos(),
    };
    std::thread::sleep(MS);
    let three = send();
    client.cancel_until(stamp).unwrap();
    assert!(eventually(|| has(&heard, GoalId::default(), "cancel 0 1")));
    assert_eq!(canceling(), [one]);
    client.cancel_all().unwrap();
    assert!(eventually(|| has(&heard, GoalId::default(), "cancel 0 2")));
    assert_eq!(canceling(), [one, three]);
    // One that is being canceled may still be reached, or given up.
    let mut goals = std::mem::take(&mut *kept.lock().unwrap());
    goals.remove(0).succeed(&Numbers::begin()).unwrap();
    drop(goals); // and one that nobody pursues any more is aborted
    assert!(eventually(|| has(&heard, one, "succeeded [0, 1]")));
    assert!(eventually(|| has(&heard, three, "aborted []")));
    assert_eq!(client.under_way(), 0);
}

/// rclc leaves a goal request lying when no goal handle is free, and loops.
#[test]
fn a_goal_too_many_is_rejected_with_the_limit_and_nothing_is_busy() {
    let _dog = watchdog("too many", LIMIT);
    let [server, client] = in_process();
    let (kept, serving, log) = keep(&server, ActionOptions::goals(2));
    let (client, heard, following) = follow(&client, 3);
    // The callback waits with the first answer: no rejection makes room before the fourth goal.
    let held = heard.lock().unwrap();
    let ids: Vec<_> = (0..3)
        .map(|_| client.send(&Order::default()).unwrap())
        .collect();
    assert_eq!(
        client.send(&Order::default()),
        Err(CallError::TooMany { limit: 3 })
    );
    drop(held);
    assert!(eventually(|| has(&heard, ids[2], "Rejected")));
    assert!(
        eventually(|| log.has("too many, the limit is 2")),
        "{:?}",
        log.lines()
    );
    assert_eq!(kept.lock().unwrap().len(), 2);
    for running in [&serving, &following] {
        let state = || {
            let report = running.report();
            let ran: u64 = report.handles.iter().map(|h| h.stats.executed).sum();
            (ran, report.dispatcher.rounds)
        };
        assert!(settles(state), "all is taken");
    }
    let stats = serving.stats("/server/srv:/fib/_action/send_goal").unwrap();
    assert_eq!((stats.executed, stats.errors, stats.waiting), (3, 1, 0));
    // A goal whose result was got makes room at once.
    kept.lock()
        .unwrap()
        .remove(0)
        .succeed(&Numbers::begin())
        .unwrap();
    assert!(eventually(|| has(&heard, ids[0], "succeeded")));
    let next = client.send(&Order::default()).unwrap();
    assert!(eventually(|| has(&heard, next, "accepted")));
    // Its own table is full again: what is forgotten makes room there.
    assert!(client.forget(next) && !client.forget(next));
}

/// Forgotten goals go on at the server, and their results are not waited for: as many can be
/// forgotten as the program likes, before and after they are accepted.
#[test]
fn a_forgotten_goal_leaves_room_for_later_ones() {
    let _dog = watchdog("forget", 2 * LIMIT);
    let [server, client] = in_process();
    let (client, heard, following) = follow(&client, 1);
    for _ in 0..11 {
        let unanswered = client.send(&Order::default()).unwrap();
        assert!(client.forget(unanswered));
    }
    let (kept, _serving, _) = keep(&server, ActionOptions::goals(64));
    for _ in 0..11 {
        let id = client.send(&Order::default()).unwrap();
        assert!(eventually(|| !of(&heard, id).is_empty()));
        assert_eq!(of(&heard, id), ["accepted"]);
        assert!(client.forget(id));
    }
    let last = client.send(&Order::default()).unwrap();
    assert!(eventually(|| has(&heard, last, "accepted")));
    // The results come late, and those of forgotten goals reach nobody.
    let results = "/client/cli:/fib/_action/get_result";
    let stats = || following.stats(results).unwrap();
    assert!(eventually(|| kept.lock().unwrap().len() == 12));
    let goals = std::mem::take(&mut *kept.lock().unwrap());
    for (goal, ended) in goals.iter().zip(1..) {
        goal.succeed(&Numbers::begin()).unwrap();
        assert!(eventually(|| stats().executed + stats().discarded == ended));
    }
    assert!(eventually(|| has(&heard, last, "succeeded [0, 1]")));
    assert_eq!((stats().executed, stats().discarded), (1, 11));
}

/// rclc never serves `goal_expired`, and takes the status messages of no server.
#[test]
fn results_expire_and_every_status_is_taken() {
    let _dog = watchdog("expiry", LIMIT);
    let [server, client] = in_process();
    // Longer than the way to the server on a loaded machine.
    let options = ActionOptions::goals(2).keep_results(2000 * MS);
    let (kept, serving, _) = keep(&server, options);
    let node = client.node("client").unwrap();
    let sizes = Arc::new(Mutex::new(Vec::new()));
    let (mut exec, _) = executor(&client);
    let note = Arc::clone(&sizes);
    let sender: ActionClient<Fibonacci> =
        node.action_client("fib", ActionOptions::goals(2)).unwrap();
    let asker: Client<GetResult<Fibonacci>> = node
        .client("fib/_action/get_result", Qos::reliable(), LIMIT)
        .unwrap();
    let statuses = Arc::new(Mutex::new(Vec::new()));
    let answers = Arc::clone(&statuses);
    exec.worker("follow")
        .follow(&sender, |_, _, _| {})
        .unwrap()
        .subscribe(
            &node,
            "fib/_action/status",
            Qos::reliable(),
            move |all: &GoalStatusArray, _| {
                note.lock().unwrap().push(all.status_list.len());
            },
        )
        .unwrap()
        .replies::<GetResult<Fibonacci>, _, _>(&asker, move |answer, _| {
            answers.lock().unwrap().push(answer.unwrap().status);
        })
        .unwrap();
    let following = exec.start().unwrap();
    let id = sender.send(&Order::default()).unwrap();
    assert!(eventually(|| kept.lock().unwrap().len() == 1));
    let goal = kept.lock().unwrap().remove(0);
    goal.succeed(&Numbers::begin()).unwrap();
    asker.call(&GetResultRequest::new(id)).unwrap(); // at once: it is kept
    assert!(eventually(|| statuses.lock().unwrap().len() == 1));
    assert!(eventually(|| goal.state().is_none()), "it expires");
    asker.call(&GetResultRequest::new(id)).unwrap();
    assert!(eventually(|| statuses.lock().unwrap().len() == 2));
    assert_eq!(*statuses.lock().unwrap(), [4, 0], "succeeded, then unknown");
    assert_eq!(goal.succeed(&Numbers::begin()), Err(GoalError::Expired));
    assert!(
        eventually(|| sizes.lock().unwrap().last() == Some(&0)),
        "no goal is known"
    );
    let taken = || {
        let stats = following.stats("/client/sub:/fib/_action/status").unwrap();
        (
            stats.received - stats.dropped - stats.executed,
            stats.waiting,
        )
    };
    assert!(eventually(|| taken() == (0, 0)), "{:?}", taken());
    let expiries = || {
        serving
            .stats("/server/timer:/fib/_action/expiry")
            .unwrap()
            .executed
    };
    assert!(
        eventually(|| expiries() == 1),
        "it runs when there is something to do"
    );
}

#[test]
fn results_wait_for_the_end_whoever_asks_and_up_to_so_many() {
    let _dog = watchdog("askers", LIMIT);
    let bus = replenish::middleware::InProcessBus::new();
    let [server, client, others] = [(); 3].map(|()| Context::new(bus.participant()));
    let (kept, serving, log) = keep(&server, ActionOptions::goals(1).askers(3));
    let (sender, heard, _following) = follow(&client, 1);
    let node = others.node("others").unwrap();
    let asker: Client<GetResult<Fibonacci>> = node
        .client("fib/_action/get_result", Qos::reliable(), LIMIT)
        .unwrap();
    let answers = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&answers);
    let (mut exec, _) = executor(&others);
    exec.worker("ask")
        .replies::<GetResult<Fibonacci>, _, _>(&asker, move |answer, cx| {
            let GetResultResponse { status, result } = answer.unwrap();
            let got = (cx.request().number(), *status, result.clone());
            note.lock().unwrap().push(got);
        })
        .unwrap();
    let _asking = exec.start().unwrap();
    let id = sender.send(&Order::default()).unwrap(); // its client asks by itself
    let results = || {
        serving
            .stats("/server/srv:/fib/_action/get_result")
            .unwrap()
    };
    assert!(eventually(|| results().executed == 1));
    let numbers = [(); 3].map(|()| asker.call(&GetResultRequest::new(id)).unwrap());
    assert!(eventually(|| results().executed == 4));
    assert_eq!(results().errors, 1);
    assert!(log.has("too many ask for the result of one goal: the limit is 3"));
    assert!(answers.lock().unwrap().is_empty() && of(&heard, id) == ["accepted"]);
    kept.lock()
        .unwrap()
        .remove(0)
        .succeed(&Numbers::of(4))
        .unwrap();
    assert!(eventually(|| answers.lock().unwrap().len() == 2));
    assert!(eventually(|| has(&heard, id, "succeeded [0, 1, 1, 2]")));
    let expected = [0, 1].map(|n| (numbers[n], 4, Numbers::of(4)));
    assert_eq!(*answers.lock().unwrap(), expected);
}

/// The decision may be made later and elsewhere; without one the goal is rejected.
#[test]
fn a_goal_may_be_accepted_later_and_executed_later_still() {
    let _dog = watchdog("later", LIMIT);
    let [server, client] = in_process();
    let node = server.node("server").unwrap();
    let (mut exec, _) = executor(&server);
    let offered: Arc<Mutex<Vec<NewGoal<Fibonacci>>>> = Arc::default();
    let store = Arc::clone(&offered);
    let goal = move |_: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        store.lock().unwrap().push(new);
    };
    exec.worker("serve")
        .serve_action(&node, "fib", ActionOptions::goals(2), goal, |_, _| false)
        .unwrap();
    let _serving = exec.start().unwrap();
    let (client, heard, _following) = follow(&client, 2);
    let ids = [(); 2].map(|()| client.send(&Order::default()).unwrap());
    assert!(eventually(|| offered.lock().unwrap().len() == 2));
    drop(offered.lock().unwrap().pop());
    assert!(eventually(|| of(&heard, ids[1]) == ["Rejected"]));
    let new = offered.lock().unwrap().pop().unwrap();
    assert_eq!(new.id(), ids[0]);
    let goal = new.accept_for_later().unwrap();
    assert!(eventually(|| has(&heard, ids[0], "State(accepted)")));
    client.cancel(ids[0]).unwrap();
    let unwilling = format!("cancel {} 0", CancelGoalResponse::ERROR_REJECTED);
    assert!(eventually(|| has(&heard, ids[0], &unwilling)));
    assert!(
        goal.succeed(&Numbers::begin()).is_err(),
        "it does not execute"
    );
    goal.execute().unwrap();
    assert!(eventually(|| has(&heard, ids[0], "State(executing)")));
    assert!(goal.execute().is_err(), "it does already");
    goal.abort(&Numbers::begin()).unwrap();
    assert!(eventually(|| has(&heard, ids[0], "aborted [0, 1]")));
}

#[test]
fn without_a_server_a_goal_is_lost_in_time() {
    let _dog = watchdog("no server", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("client").unwrap();
    let options = ActionOptions::goals(1).reply_within(20 * MS);
    let client: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    assert!(!client.wait_for_server(MS).unwrap());
    let lost = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&lost);
    let (mut exec, _) = executor(&ctx);
    exec.worker("follow")
        .follow(&client, move |id, update, _| match update {
            GoalUpdate::Lost(why) => note.lock().unwrap().push((id, why)),
            other => panic!("{other:?}"),
        })
        .unwrap();
    let _following = exec.start().unwrap();
    let id = client.send(&Order::default()).unwrap();
    client.cancel(id).unwrap();
    assert!(eventually(|| lost.lock().unwrap().len() == 2));
    let expected = [Lost::Goal, Lost::Cancel].map(|lost| (id, lost(NoReply::TimedOut)));
    assert_eq!(*lost.lock().unwrap(), expected);
    assert_eq!(client.under_way(), 0);
}

#[test]
fn options_out_of_range_are_named() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    for (options, text) in [
        (
            ActionOptions::goals(0),
            "action /fib: goals = 0 is not allowed: 1..=64",
        ),
        (
            ActionOptions::goals(65),
            "action /fib: goals = 65 is not allowed: 1..=64",
        ),
        (
            ActionOptions::goals(1).askers(0),
            "action /fib: askers = 0 is not allowed: 1..=64",
        ),
        (
            ActionOptions::goals(1).feedback_depth(0),
            "action /fib: feedback_depth = 0 is not allowed: 1..=4096",
        ),
    ] {
        let refused = node.action_client::<Fibonacci>("fib", options).unwrap_err();
        assert_eq!(refused.to_string(), text);
    }
}

/// Also when there would be no room for another goal: those under way never end.
#[test]
fn goals_without_an_executor_any_more_are_errors() {
    let _dog = watchdog("gone", LIMIT);
    let [_server, client] = in_process();
    let (client, _, following) = follow(&client, 1);
    let id = client.send(&Order::default()).unwrap();
    client.cancel(id).unwrap();
    following.stop();
    assert_eq!(client.send(&Order::default()), Err(CallError::Gone));
    assert_eq!(client.cancel(id), Err(CallError::Gone));
    assert_eq!(client.cancel_all(), Err(CallError::Gone));
}

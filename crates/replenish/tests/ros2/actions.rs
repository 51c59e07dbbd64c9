//! Actions: rclpy's client and our server, our client and rclpy's server.

use crate::peer::{Foreign, Peer};
use crate::support::{budget, eventually, executor, node};
use replenish::{
    ActionClient, ActionOptions, CallbackContext, GoalHandle, GoalId, GoalState, GoalUpdate,
    NewGoal,
};
use replenish_interfaces::test_msgs::action::{
    Fibonacci, FibonacciFeedback, FibonacciGoal, FibonacciResult,
};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const GOALS: usize = 20;

/// The first numbers of the sequence.
fn fibonacci(order: usize) -> Vec<i32> {
    let mut numbers: Vec<i32> = vec![0, 1];
    while numbers.len() < order {
        let [.., a, b] = numbers[..] else {
            unreachable!()
        };
        numbers.push(a.wrapping_add(b));
    }
    numbers
}

/// The orders of the goals that are reached.
fn order(goal: usize) -> usize {
    3 + goal % 8
}

type Pursued = Arc<Mutex<Vec<(GoalHandle<Fibonacci>, usize, Vec<i32>)>>>;

/// One number more for every goal; a goal that is canceled or complete ends.
fn pursue(goals: &Pursued) {
    goals.lock().unwrap().retain_mut(|(goal, order, numbers)| {
        let sequence = numbers.clone();
        if goal.is_canceling() {
            goal.canceled(&FibonacciResult { sequence }).unwrap();
            return false;
        }
        if numbers.len() >= *order {
            goal.succeed(&FibonacciResult { sequence }).unwrap();
            return false;
        }
        *numbers = fibonacci(numbers.len() + 1);
        let sequence = numbers.clone();
        goal.feedback(&FibonacciFeedback { sequence }).unwrap();
        true
    });
}

/// rclpy sends goals to a server of ours: reached, canceled, rejected.
pub(crate) fn server(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let goals = Pursued::default();
    let (begun, timed) = (Arc::clone(&goals), Arc::clone(&goals));
    let goal = move |goal: &FibonacciGoal, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let Ok(order @ 2..) = usize::try_from(goal.order) else {
            return new.reject();
        };
        let goal = new.accept()?;
        begun.lock().unwrap().push((goal, order, fibonacci(2)));
        Ok(())
    };
    let mut exec = executor(&node);
    exec.worker("server")
        .budget(budget())
        .serve_action(&node, "fib", ActionOptions::goals(8), goal, |_, _| true)
        .unwrap()
        .timer(Duration::from_millis(10), move |_| pursue(&timed))
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["action_client", &GOALS.to_string()]);
    assert_eq!(peer.line(), format!("succeeded {GOALS} of {GOALS}"));
    assert_eq!(peer.line(), "canceled 5 True");
    assert_eq!(peer.line(), "rejected True");
    let report = running.stop();
    assert!(
        report.handles.iter().all(|h| h.stats.errors == 0),
        "{report}"
    );
}

type Heard = Arc<Mutex<Vec<(GoalId, String)>>>;

/// News of one goal of one kind, in order.
fn of(heard: &Heard, id: GoalId, kind: &str) -> Vec<String> {
    let heard = heard.lock().unwrap();
    let mine = heard
        .iter()
        .filter(|(i, t)| *i == id && t.starts_with(kind));
    mine.map(|(_, t)| t.clone()).collect()
}

/// We send goals to a server of rclpy: reached, canceled, rejected.
pub(crate) fn client(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let options = ActionOptions::goals(4).feedback_depth(100);
    let client: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    let heard = Heard::default();
    let note = Arc::clone(&heard);
    let mut exec = executor(&node);
    exec.worker("client")
        .budget(budget())
        .follow(&client, move |id, update, _| {
            let text = match update {
                GoalUpdate::Feedback(f) => format!("feedback {:?}", f.sequence),
                GoalUpdate::Result(state, r) => format!("result {state} {:?}", r.sequence),
                GoalUpdate::Cancel(c) => format!("cancel {}", c.return_code),
                other => format!("{other:?}"),
            };
            note.lock().unwrap().push((id, text));
        })
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["action_server"]);
    assert_eq!(peer.line(), "ready");
    assert!(client.wait_for_server(Duration::from_secs(60)).unwrap());
    let send = |order: usize| {
        let order = i32::try_from(order).unwrap();
        client.send(&FibonacciGoal { order }).unwrap()
    };
    let all = || format!("{:?}", heard.lock().unwrap());
    // Feedback is volatile: both sides know each other once some of it has come.
    let known = || {
        let id = send(3);
        assert!(eventually(|| !of(&heard, id, "result").is_empty()));
        std::thread::sleep(Duration::from_millis(500));
        !of(&heard, id, "feedback").is_empty()
    };
    assert!((0..20).any(|_| known()), "{}", all());
    let mut feedbacks = 0;
    for goal in 0..GOALS {
        let (order, id) = (order(goal), send(order(goal)));
        let feedback = || of(&heard, id, "feedback");
        let complete = || !of(&heard, id, "result").is_empty();
        assert!(eventually(complete), "goal {goal}: {}", all());
        // A result that overtakes feedback on its own port ends the goal: the last may be missing.
        let expected = (3..=order).map(|len| format!("feedback {:?}", fibonacci(len)));
        let (expected, told) = (expected.collect::<Vec<_>>(), feedback());
        assert!(expected.starts_with(&told), "goal {goal}: {told:?}");
        feedbacks += told.len();
        let expected = format!("result {} {:?}", GoalState::Succeeded, fibonacci(order));
        assert_eq!(of(&heard, id, "result"), [expected]);
        assert_eq!(of(&heard, id, "Accepted").len(), 1);
    }
    assert!(feedbacks >= (0..GOALS).count(), "{}", all());
    let id = send(100_000);
    assert!(eventually(|| !of(&heard, id, "feedback").is_empty()));
    client.cancel(id).unwrap();
    assert!(
        eventually(|| !of(&heard, id, "result").is_empty()),
        "{}",
        all()
    );
    assert_eq!(of(&heard, id, "cancel"), ["cancel 0"]);
    let canceled = of(&heard, id, &format!("result {}", GoalState::Canceled));
    assert_eq!(canceled.len(), 1, "{}", all());
    let id = send(0);
    assert!(
        eventually(|| !of(&heard, id, "Rejected").is_empty()),
        "{}",
        all()
    );
    // States come by the status topic, which is transient local.
    let states = heard.lock().unwrap();
    assert!(states.iter().any(|(_, text)| text.starts_with("State")));
    drop(states);
    drop(running.stop());
}

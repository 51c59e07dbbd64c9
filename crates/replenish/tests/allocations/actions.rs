//! After the start an action allocates nothing, whatever becomes of its goals.

use crate::ALLOC;
use crate::common::fibonacci::{Fibonacci, Numbers, Order};
use crate::common::{eventually, executor};
use replenish::{
    ActionClient, ActionOptions, CallError, CallbackContext, Context, GoalHandle, GoalState,
    GoalUpdate, Lost, NewGoal, RunningGoal, sleep,
};
use replenish_testkit::alloc::exempt_this_thread;
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("nothing_allocates_for_actions", allocations),
        trial("nothing_allocates_for_goals_that_are_futures", futures),
    ]
}

/// Goals and their orders.
type Pursued = Arc<Mutex<Vec<(GoalHandle<Fibonacci>, i32)>>>;

/// A thousand goals: reached, given up, canceled and rejected in turn, four at a time.
fn allocations() {
    const GOALS: u64 = 1000;
    let _dog = watchdog("allocations of actions", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.on_event(|_| {}); // the log of a goal too many would allocate
    let pursued: Pursued = Arc::new(Mutex::new(Vec::with_capacity(8)));
    let begun = Arc::clone(&pursued);
    let options = ActionOptions::goals(4).keep_results(Duration::from_millis(20));
    let accept =
        move |goal: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| match goal.order {
            3 => new.reject(),
            order => {
                begun.lock().unwrap().push((new.accept()?, order));
                Ok(())
            }
        };
    let numbers = Numbers::of(20);
    exec.worker("serve")
        .serve_action(&node, "fib", options, accept, |_, _| true)
        .unwrap()
        .timer(Duration::from_micros(500), move |_| {
            pursued.lock().unwrap().retain(|(goal, order)| {
                goal.feedback(&numbers).unwrap();
                match order {
                    0 => goal.succeed(&numbers).unwrap(),
                    1 => goal.abort(&numbers).unwrap(),
                    _ if goal.is_canceling() => goal.canceled(&numbers).unwrap(),
                    _ => return true,
                }
                false
            });
        })
        .unwrap();
    let client: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    let ended = Arc::new([const { AtomicU64::new(0) }; 4]);
    let count = Arc::clone(&ended);
    let again = client.clone();
    exec.worker("follow")
        .follow(&client, move |id, update, _| {
            let kind = match update {
                GoalUpdate::Feedback(_) => return again.cancel(id).map_or(Ok(()), Ok),
                GoalUpdate::Result(GoalState::Succeeded, _) => 0,
                GoalUpdate::Result(GoalState::Aborted, _) => 1,
                GoalUpdate::Result(GoalState::Canceled, _) => 2,
                GoalUpdate::Rejected | GoalUpdate::Lost(Lost::Unknown) => 3,
                _ => return Ok::<(), CallError>(()),
            };
            count[kind].fetch_add(1, Ordering::SeqCst);
            Ok(())
        })
        .unwrap();
    let running = exec.start().unwrap();
    exempt_this_thread();
    // One goal first, so that every thread has begun, and the harness has nothing left to do.
    client.send(&Order { order: 0 }).unwrap();
    assert!(eventually(|| ended[0].swap(0, Ordering::SeqCst) == 1));
    ALLOC.arm();
    let all = || ended.iter().map(|n| n.load(Ordering::SeqCst)).sum::<u64>();
    for n in 0..GOALS {
        let order = i32::try_from(n % 4).unwrap();
        assert!(eventually(|| n < all() + 4), "{n}: {ended:?}");
        client.send(&Order { order }).unwrap();
    }
    assert!(eventually(|| all() == GOALS), "{ended:?}");
    assert_eq!(ALLOC.disarm(), 0, "{ended:?}");
    // A goal that finds the table full is rejected, too, and a result may expire before it is asked
    // for.
    assert!(ended[3].load(Ordering::SeqCst) >= GOALS / 4, "{ended:?}");
    drop(running);
}

/// Hundreds of goals, one after another, each a future that sleeps.
fn futures() {
    const GOALS: u64 = 300;
    let _dog = watchdog("allocations of goals", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let options = ActionOptions::goals(4);
    let client: ActionClient<Fibonacci> = node.action_client("fib", options).unwrap();
    exec.worker("serve")
        .serve_action_async(
            &node,
            "fib",
            options,
            |goal: &Order| goal.order != 3,
            |goal, running: RunningGoal<Fibonacci>| async move {
                let numbers = Numbers::of(20);
                sleep(Duration::from_micros(100)).await;
                running.feedback(&numbers).map_err(|_| Numbers::default())?;
                if goal.order == 1 {
                    Err(numbers)
                } else {
                    Ok(numbers)
                }
            },
        )
        .unwrap();
    let ended = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&ended);
    let sender = client.clone();
    let task = async move {
        for order in (0..4).cycle() {
            let goal = match sender.send_async(&Order { order }).await {
                Ok(Some(goal)) => goal.result().await.map(|_| ()),
                other => other.map(|_| ()),
            };
            goal.unwrap();
            count.fetch_add(1, Ordering::SeqCst);
        }
    };
    exec.worker("w").goals(&client).unwrap().task(task).unwrap();
    let running = exec.start().unwrap();
    exempt_this_thread();
    let done = || ended.load(Ordering::SeqCst);
    assert!(eventually(|| done() > 8)); // every thread has begun
    ALLOC.arm();
    let first = done();
    assert!(eventually(|| done() >= first + GOALS), "{}", done());
    assert_eq!(ALLOC.disarm(), 0);
    drop(running);
}

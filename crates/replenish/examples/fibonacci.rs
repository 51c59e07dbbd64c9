//! An action: Fibonacci numbers, one more every 20 ms, with feedback. A first goal is reached; the
//! second is canceled when it has come far enough. One timer pursues all goals: no thread per goal.
//!
//! Run: `cargo run -p replenish --example fibonacci` in one process; with an agent's address
//! (`127.0.0.1:8888`) behind it, through that agent.

use replenish::{
    ActionClient, ActionOptions, CallError, CallbackContext, Context, Error, Every, Executor,
    GoalHandle, GoalState, GoalUpdate, NewGoal,
};
use replenish_interfaces::example_interfaces::action::{
    Fibonacci, FibonacciFeedback, FibonacciGoal, FibonacciResult,
};
use std::{sync::mpsc, time::Duration};

fn main() -> Result<(), Error> {
    let ms = Duration::from_millis;
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let (node, mut exec) = (ctx.node("fibonacci")?, Executor::new(&ctx));

    // The server: at most 8 goals at a time, a ninth one is rejected; whoever wants to cancel may.
    let (begin, begun) = mpsc::channel();
    let mut goals = Vec::new();
    let eight = ActionOptions::goals(8);
    let accept = move |goal: &FibonacciGoal, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        match usize::try_from(goal.order) {
            Ok(order @ 1..=64) => begin.send((new.accept()?, order, vec![])).or(Ok(())),
            _ => new.reject(),
        }
    };
    exec.worker("server")
        .serve_action(&node, "fibonacci", eight, accept, |_, _| true)?
        .timer(ms(20), move |_| {
            goals.extend(begun.try_iter());
            goals.retain_mut(|(goal, order, numbers)| step(goal, *order, numbers));
        })?;

    // The client: whatever is heard of any of its goals comes to one callback.
    let client: ActionClient<Fibonacci> = node.action_client("fibonacci", eight)?;
    let (first, next) = (client.clone(), client.clone());
    exec.worker("client")
        .follow(&client, move |id, update, cx| {
            match update {
                GoalUpdate::Feedback(f) if f.sequence.len() == 12 => next.cancel(id)?,
                GoalUpdate::Feedback(f) => println!("so far: {:?}", f.sequence),
                GoalUpdate::Result(GoalState::Succeeded, r) => {
                    println!("succeeded: {:?}", r.sequence);
                    next.send(&FibonacciGoal { order: 50 })?;
                }
                GoalUpdate::Result(..) => cx.stop(),
                other => println!("{other:?}"),
            }
            Ok::<_, CallError>(())
        })?
        .timer(Every::once(ms(10)), move |_| {
            first.send(&FibonacciGoal { order: 8 }).map(drop)
        })?;
    exec.spin().map(drop)
}

/// One more number; whether the goal goes on. One that is dropped before its end is aborted.
fn step(goal: &GoalHandle<Fibonacci>, order: usize, numbers: &mut Vec<i32>) -> bool {
    if numbers.len() < order && !goal.is_canceling() {
        numbers.push(numbers.iter().rev().take(2).sum::<i32>().max(1));
        let sequence = numbers.clone();
        return goal.feedback(&FibonacciFeedback { sequence }).is_ok();
    }
    let sequence = numbers.clone();
    let result = FibonacciResult { sequence };
    if goal.is_canceling() {
        goal.canceled(&result).ok();
    } else {
        goal.succeed(&result).ok();
    }
    false
}

//! Experiment 1 on the executor itself, in one process: a timer pings every 10 ms, a budgeted
//! worker and a worker below it answer with bursts of 10 ms.

use crate::say;
use crate::work::burst;
use core::time::Duration;
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Error, Executor, Policy, Qos};
use replenish_os::clock;

/// Length of the measurement, in ns.
const LENGTH: u64 = 10_000_000_000;
const STACK: usize = 6144;

/// Runs it for 10 s with `budget` ms per 100 ms and prints a line.
pub(crate) fn run(budget: u64) {
    if let Err(why) = measure(budget) {
        say!("the executor did not run: {why}");
    }
}

fn measure(budget: u64) -> Result<(), Error> {
    let ms = Duration::from_millis;
    let context = Context::in_process();
    let node = context.node("pong")?;
    let mut exec = Executor::new(&context);
    exec.on_event(|event| say!("  {event}"));
    let pings = [
        node.publisher::<Int32>("high_ping", Qos::best_effort())?,
        node.publisher::<Int32>("low_ping", Qos::best_effort())?,
    ];
    let mut number = 0;
    exec.worker("ping")
        .policy(Policy::fifo(70)?)
        .stack_size(STACK)
        .timer(ms(10), move |_| {
            number += 1;
            let ping = Int32 { data: number };
            pings.iter().for_each(|p| {
                p.publish(&ping).ok();
            });
        })?;
    let high = exec
        .worker("high")
        .policy(Policy::fifo(60)?)
        .budget(Budget::of(ms(budget)).every(ms(100)))
        .stack_size(STACK);
    answer(high, &node, "high")?;
    let low = exec
        .worker("low")
        .policy(Policy::fifo(50)?)
        .stack_size(STACK);
    answer(low, &node, "low")?;
    let running = exec.start()?;
    clock::sleep_until(clock::monotonic() + LENGTH);
    let count = |id: &str| running.stats(id).map_or(0, |s| s.executed);
    let (high, low) = (count("/pong/sub:/high_ping"), count("/pong/sub:/low_ping"));
    let pings = count("ping/timer:0");
    say!("  executor, {budget} ms every 100 ms: high {high}, low {low}, pings {pings}");
    running.stop();
    Ok(())
}

fn answer(
    worker: replenish::WorkerBuilder<'_>,
    node: &replenish::Node,
    name: &str,
) -> Result<(), Error> {
    let topic = alloc::format!("{name}_ping");
    let pong = node.publisher::<Int32>(&alloc::format!("{name}_pong"), Qos::best_effort())?;
    worker.subscribe(
        node,
        topic.as_str(),
        Qos::best_effort(),
        move |ping: &Int32, _| {
            burst();
            pong.publish(ping)
        },
    )?;
    Ok(())
}

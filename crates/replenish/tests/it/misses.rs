//! Callbacks that miss their deadline: some input is left out afterwards, and what somebody waits
//! for is not.

use crate::common::{Echo, eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{CallError, Client, Context, HandleOptions, OnMiss, Qos, sleep};
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// Leaves out an input whatever the callback takes.
fn never_in_time() -> HandleOptions {
    HandleOptions::new().deadline(Duration::ZERO, OnMiss::SkipNext)
}

/// The wake-up of a future is no input: only the timer's next release is left out.
#[test]
fn a_future_goes_on_after_a_missed_deadline() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let counts = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
    let mut worker = exec.worker("w");
    for (n, options) in [
        HandleOptions::new().on_miss(OnMiss::SkipNext),
        never_in_time(),
    ]
    .into_iter()
    .enumerate()
    {
        let count = Arc::clone(&counts[n]);
        worker = worker
            .timer_async(5 * MS, move || {
                let count = Arc::clone(&count);
                async move {
                    std::thread::sleep(6 * MS); // longer than the period, in the first poll
                    sleep(MS).await;
                    sleep(MS).await;
                    count.fetch_add(1, Ordering::Relaxed);
                }
            })
            .unwrap()
            .options(options);
    }
    let running = exec.start().unwrap();
    for (n, count) in counts.iter().enumerate() {
        let id = format!("w/timer:{n}");
        let ends = eventually(|| count.load(Ordering::Relaxed) >= 5);
        let stats = running.stats(&id).unwrap();
        assert!(ends && stats.deadline_misses >= 4, "{id}: {stats:?}");
        assert!(stats.skipped >= 4, "{id}: {stats:?}");
    }
    drop(running.stop());
}

/// A reply comes once: if it is left out, somebody waits for it for ever.
#[test]
fn replies_are_not_left_out_after_a_missed_deadline() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    exec.worker("server")
        .serve::<Echo, _>(&node, "echo", Qos::services(), |request, response, _| {
            response.data = request.data;
        })
        .unwrap();
    let client = || -> Client<Echo> { node.client("echo", Qos::services(), LIMIT).unwrap() };
    let (awaited, called) = (client(), client());
    let (sum, heard) = (
        Arc::new(AtomicI32::new(0)),
        Arc::new(Mutex::new(Vec::new())),
    );
    let (to, asks, note) = (Arc::clone(&sum), awaited.clone(), Arc::clone(&heard));
    exec.worker("w")
        .calls(&awaited)
        .unwrap()
        .options(never_in_time())
        .replies(&called, move |reply, _| {
            note.lock().unwrap().push(reply.map(|n| n.data));
        })
        .unwrap()
        .options(never_in_time())
        .task(async move {
            for data in 1..=4 {
                let reply = asks.call_async(&Int32 { data }).await?;
                to.fetch_add(reply.data, Ordering::Relaxed);
            }
            Ok::<(), CallError>(())
        })
        .unwrap();
    let running = exec.start().unwrap();
    for data in 1..=4 {
        called.call(&Int32 { data }).unwrap();
    }
    assert!(eventually(|| sum.load(Ordering::Relaxed) == 10));
    assert!(eventually(
        || *heard.lock().unwrap() == [Ok(1), Ok(2), Ok(3), Ok(4)]
    ));
    for handle in running.stop().handles {
        let stats = handle.stats;
        assert_eq!((stats.discarded, stats.skipped), (0, 0), "{stats:?}");
    }
}

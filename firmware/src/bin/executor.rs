//! Experiment 1 on the executor itself, in one image: a worker pings, a budgeted worker and a
//! worker below it answer. An answer takes 10 ms of its worker's CPU time, what the executor does
//! for it included. The command line is the budget in ms per 100 ms.
#![no_std]
#![no_main]

extern crate alloc;

use core::time::Duration;
use firmware::work::Burst;
use firmware::{console, say};
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Error, Executor, Policy, Qos};
use replenish_os::clock;
use replenish_os::freertos::{SealedHeap, kernel, panicked, start, tasks};

#[global_allocator]
static HEAP: SealedHeap<{ 96 * 1024 }> = SealedHeap::new();

/// Length of the measurement, in ns.
const LENGTH: u64 = 10_000_000_000;

/// A worker's stack; it uses 2.8 kB.
const STACK: usize = 4096;

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(97, 16384, || {
        let mut line = [0_u8; 64];
        let words = console::command_line(&mut line);
        let budget = words.split_whitespace().last().and_then(|w| w.parse().ok());
        if let Err(e) = run(budget.unwrap_or(30)) {
            say!("{e}");
            console::exit(false)
        }
        console::exit(panicked().count == 0 && HEAP.usage().refused == 0)
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

fn run(budget: u64) -> Result<(), Error> {
    let burst = Burst::calibrate();
    let before = HEAP.usage().used;
    let ms = Duration::from_millis;
    let context = Context::in_process();
    let node = context.node("pong")?;
    let mut exec = Executor::new(&context);
    exec.on_event(|event| say!("{event}"));
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
    let held = Budget::of(ms(budget)).every(ms(100));
    let pong = node.publisher::<Int32>("high_pong", Qos::best_effort())?;
    let mut work = Work::new(burst);
    exec.worker("high")
        .policy(Policy::fifo(60)?)
        .budget(held)
        .stack_size(STACK)
        .subscribe(
            &node,
            "high_ping",
            Qos::best_effort(),
            move |ping: &Int32, _| {
                work.answer();
                pong.publish(ping)
            },
        )?;
    let pong = node.publisher::<Int32>("low_pong", Qos::best_effort())?;
    let mut work = Work::new(burst);
    exec.worker("low")
        .policy(Policy::fifo(50)?)
        .stack_size(STACK)
        .subscribe(
            &node,
            "low_ping",
            Qos::best_effort(),
            move |ping: &Int32, _| {
                work.answer();
                pong.publish(ping)
            },
        )?;
    let described = HEAP.usage().used;
    let running = exec.start()?;
    let started = HEAP.usage().used;
    HEAP.seal();
    let begin = clock::monotonic();
    clock::sleep_until(begin + LENGTH);
    let elapsed = clock::monotonic() - begin;
    let count = |id: &str| running.stats(id).map_or(0, |s| s.executed);
    let (high, low) = (count("/pong/sub:/high_ping"), count("/pong/sub:/low_ping"));
    let timer = count("ping/timer:0");
    let heap = HEAP.usage();
    let kernel = kernel();
    let switches: u32 = tasks().map(|t| t.blocks + t.preemptions).sum();
    say!(
        "{{\"budget_ms\": {budget}, \"high\": {high}, \"low\": {low}, \"pings\": {timer}, \"elapsed_ns\": {elapsed}, \
         \"heap_described\": {}, \"heap_started\": {}, \"heap_refused\": {}, \"alarms\": {}, \"idle_waits\": {}, \"switches\": {switches}, \"tasks\": [",
        described - before,
        started - before,
        heap.refused,
        kernel.alarms,
        kernel.idle_waits,
    );
    let mut comma = ' ';
    for task in tasks() {
        say!(
            "{comma}{{\"name\": \"{}\", \"cpu_ns\": {}, \"stack_bytes\": {}, \"stack_used\": {}}}",
            task.name,
            task.cpu,
            task.stack_bytes,
            task.stack_bytes - task.stack_unused,
        );
        comma = ',';
    }
    say!("]}}");
    core::mem::forget(running);
    Ok(())
}

/// Answers of 10 ms of the worker's CPU time each, counted from the first callback on.
struct Work {
    burst: Burst,
    due: u64,
}

impl Work {
    const fn new(burst: Burst) -> Self {
        Self { burst, due: 0 }
    }

    fn answer(&mut self) {
        if self.due == 0 {
            self.due = clock::thread_cpu();
        }
        self.due += 10_000_000;
        self.burst.until(self.due);
    }
}

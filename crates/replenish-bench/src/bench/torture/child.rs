//! The executor under test: `bench torture --child`, which reads its case from standard input.

use super::case::{self, Case, Stranger, Work, Worker};
use crate::load::{MS, Nanos};
use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, Executor, Group, HandleOptions, Low, Node, Params, Policy, Publisher,
    Qos, Removal, RunningExecutor,
};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::signals::Stop;
use replenish_cli::supervised::emit;
use replenish_os::{CpuSet, ThreadSpec, clock};
use serde::{Deserialize, Serialize};
use std::io::BufRead as _;
use std::time::Duration;

/// The parent's request.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Order {
    pub case: Case,
    /// The CPU under test.
    pub cpu: usize,
    /// The CPU of everything else.
    pub support: usize,
}

/// The child's answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum News {
    /// All threads run.
    Started { fallbacks: Vec<String> },
    /// The executor's own account, worker by worker.
    Account(Vec<Reading>),
    /// It has stopped.
    Ended { stuck: Vec<String> },
}

/// One worker's account, and the time around the reading.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Reading {
    pub before: Nanos,
    pub after: Nanos,
    pub high: Nanos,
    pub low: Nanos,
    pub exhaustions: u64,
    pub replenishments: u64,
}

/// Runs the case until standard input ends. Each line asks for the account.
pub(super) fn run() -> Outcome {
    let mut lines = std::io::stdin().lock().lines().map_while(Result::ok);
    let order = lines.next().unwrap_or_default();
    let order: Order = serde_json::from_str(&order).map_err(Failure::refused)?;
    std::panic::set_hook(Box::new(|_| ())); // panics are part of some cases
    let (me, support) = (replenish_os::current_tid(), CpuSet::one(order.support));
    replenish_os::set_affinity(me, &support).map_err(Failure::refused)?;
    let stop = Stop::default();
    let running = start(&order, &stop)?;
    let fallbacks = running.report().fallbacks;
    let fallbacks = fallbacks.iter().map(ToString::to_string).collect();
    emit(&News::Started { fallbacks });
    let workers = order.case.workers.len();
    std::thread::scope(|scope| {
        if order.case.churn_every > 0 {
            scope.spawn(|| churn(&running, workers, order.case.churn_every, &stop));
        }
        for _ in lines {
            emit(&News::Account(account(&running, workers)));
        }
        stop.trigger();
    });
    let stuck = running.stop().stuck;
    emit(&News::Ended { stuck });
    Ok(())
}

fn start(order: &Order, stop: &Stop) -> Result<RunningExecutor, Failure> {
    let context = Context::in_process();
    let node = context.node("torture").map_err(Failure::refused)?;
    let mut executor = Executor::new(&context);
    executor
        .no_ledger()
        .switch_log(order.case.records)
        .dispatcher_cpu(order.support)
        // A case's callback sleeps for a while and burns at its background priority.
        .stop_grace(Duration::from_secs(3))
        .on_event(|_| ());
    let groups: Vec<Group> = (0..=u8::MAX).map(|n| Group::new(&n.to_string())).collect();
    for (index, worker) in order.case.workers.iter().enumerate() {
        let group = worker.group.and_then(|g| groups.get(usize::from(g)));
        add(
            &mut executor,
            &node,
            (index, worker),
            (order.cpu, group),
            stop,
        )?;
    }
    let running = executor.start().map_err(Failure::refused)?;
    for stranger in &order.case.strangers {
        strange(*stranger, order.cpu, stop)?;
    }
    Ok(running)
}

fn add(
    executor: &mut Executor,
    node: &Node,
    (index, worker): (usize, &Worker),
    (cpu, group): (usize, Option<&Group>),
    stop: &Stop,
) -> Result<(), Failure> {
    let low = worker.background.map_or(Low::Suspend, Low::Background);
    let (budget, period) = (worker.budget, worker.period);
    let params = Params::new(worker.priority, low, budget, period, worker.max_repl);
    let policy = Policy::sporadic(params.map_err(Failure::refused)?).map_err(Failure::refused)?;
    let name = case::name(index);
    let builder = executor
        .worker(&name)
        .policy(policy)
        .cpu(cpu)
        .capacity(4)
        .stack_size(128 << 10);
    let often = Duration::from_millis(1);
    let builder = match worker.work {
        Work::Endless => builder.timer(often, |cx| while !cx.is_stopping() {}),
        Work::BackToBack { burn } => builder.timer(often, move |cx| burn_for(burn, cx)),
        Work::Periodic { every, burn } => {
            builder.timer(Duration::from_nanos(every), move |cx| burn_for(burn, cx))
        }
        Work::Sleepy { burn, sleep } => builder.timer(often, move |cx| {
            while !cx.is_stopping() {
                burn_for(burn, cx);
                std::thread::sleep(Duration::from_nanos(sleep));
            }
        }),
        Work::Messages { every, burn } => {
            let publisher = node.publisher::<Int32>(&name, Qos::reliable());
            publish(publisher.map_err(Failure::refused)?, every, stop);
            let topic = name.as_str();
            builder.subscribe(node, topic, Qos::reliable(), move |_: &Int32, cx| {
                burn_for(burn, cx);
            })
        }
    };
    let mut builder = builder.map_err(Failure::refused)?;
    if let Some(group) = group {
        builder = builder.options(HandleOptions::new().group(group));
    }
    if worker.panics {
        let mut runs = 0;
        let panics = move |_: &CallbackContext<'_>| {
            runs += 1;
            if runs == 3 {
                std::panic::resume_unwind(Box::new("a case's own panic"));
            }
        };
        let every = Duration::from_nanos(worker.period);
        builder.timer(every, panics).map_err(Failure::refused)?;
    }
    Ok(())
}

/// Consumes so much CPU time of the calling thread.
fn burn_for(burn: Nanos, cx: &CallbackContext<'_>) {
    burn_unless(burn, || cx.is_stopping());
}

/// The same without asking for the CPU clock again and again: each answer is a line in the trace.
fn burn_unless(burn: Nanos, stops: impl Fn() -> bool) {
    let end = clock::thread_cpu().saturating_add(burn);
    loop {
        let left = end.saturating_sub(clock::thread_cpu());
        if left == 0 || stops() {
            return;
        }
        // CPU time passes no faster than time.
        let until = clock::monotonic().saturating_add(left.min(MS));
        while clock::monotonic() < until {}
    }
}

/// Sends numbers from a thread of its own.
fn publish(publisher: Publisher<Int32>, every: Nanos, stop: &Stop) {
    let stop = stop.clone();
    std::thread::spawn(move || {
        let mut due = clock::monotonic();
        while !stop.is_triggered() {
            due = (due + every).max(clock::monotonic().saturating_sub(10 * MS));
            clock::sleep_until(due);
            publisher.publish(&Int32 { data: 1 }).ok();
        }
    });
}

/// A FIFO thread of nobody.
fn strange(stranger: Stranger, cpu: usize, stop: &Stop) -> Result<(), Failure> {
    let policy = Policy::fifo(stranger.priority).map_err(Failure::refused)?;
    let spec = ThreadSpec::new("stranger").policy(policy).cpu(cpu);
    let stop = stop.clone();
    let body = move || {
        while !stop.is_triggered() {
            burn_unless(stranger.burn, || false);
            clock::sleep_until(clock::monotonic().saturating_add(stranger.sleep));
        }
    };
    replenish_os::spawn(spec, body).map_err(Failure::refused)?;
    Ok(())
}

/// Adds a handle to one worker after the other, and removes it.
fn churn(running: &RunningExecutor, workers: usize, every: Nanos, stop: &Stop) {
    let handle = running.handle();
    let mut at = 0;
    while !stop.is_triggered() {
        clock::sleep_until(clock::monotonic().saturating_add(every));
        at = (at + 1) % workers.max(1);
        let name = case::name(at);
        let timer = |cx: &CallbackContext<'_>| burn_for(20_000, cx);
        let added = handle
            .worker(&name)
            .and_then(|w| w.timer(Duration::from_millis(3), timer));
        clock::sleep_until(clock::monotonic().saturating_add(every));
        if let Ok(id) = added {
            handle.remove(&id, Removal::Detach).ok();
        }
    }
}

fn account(running: &RunningExecutor, workers: usize) -> Vec<Reading> {
    let read = |index| {
        let before = clock::monotonic();
        let usage = running.usage(&case::name(index)).unwrap_or_default();
        Reading {
            before,
            after: clock::monotonic(),
            high: usage.cpu_high,
            low: usage.cpu_low,
            exhaustions: usage.exhaustions,
            replenishments: usage.replenishments,
        }
    };
    (0..workers).map(read).collect()
}

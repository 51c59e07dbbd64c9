//! The executor under test: `bench torture --child`, which reads its case from standard input.

use super::case::{self, Case, Stranger, Work, Worker};
use crate::load::{MS, Nanos};
use replenish::args::{Environment, RosArgs};
use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, Error, Executor, Group, Guarantee, HandleOptions, Logger, Low, Node,
    Params, Policy, Publisher, Qos, Removal, RunningExecutor, log_info,
};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::signals::Stop;
use replenish_cli::supervised::emit;
use replenish_os::{CpuSet, ThreadSpec, baseline, clock};
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

/// The line that has the child give up its privileges.
pub(super) const DROP: &str = "drop";

/// The user that it is then: nobody.
const NOBODY: u32 = 65534;

/// The child's answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum News {
    /// All threads run.
    Started {
        fallbacks: Vec<String>,
        /// The workers as they are: the executor has chosen priorities and more for those with a
        /// guarantee, or has refused to keep all promises, and given none.
        workers: Vec<Worker>,
    },
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

/// Runs the case until standard input ends. Each line but [`DROP`] asks for the account.
pub(super) fn run() -> Outcome {
    let mut lines = std::io::stdin().lock().lines().map_while(Result::ok);
    let order = lines.next().unwrap_or_default();
    let order: Order = serde_json::from_str(&order).map_err(Failure::refused)?;
    std::panic::set_hook(Box::new(|_| ())); // panics are part of some cases
    let (me, support) = (replenish_os::current_tid(), CpuSet::one(order.support));
    replenish_os::set_affinity(me, &support).map_err(Failure::refused)?;
    let stop = Stop::default();
    let (running, workers) = start(&order, &stop)?;
    let fallbacks = running.report().fallbacks;
    let fallbacks = fallbacks.iter().map(ToString::to_string).collect();
    emit(&News::Started { fallbacks, workers });
    let workers = order.case.workers.len();
    std::thread::scope(|scope| {
        if order.case.churn_every > 0 {
            scope.spawn(|| churn(&running, workers, order.case.churn_every, &stop));
        }
        for line in lines {
            if line == DROP {
                // It waits for every thread, and some get no CPU before the executor stops, once
                // nobody raises them. Refused, the privileges stay, and so do the bounds.
                std::thread::spawn(|| baseline::become_user(NOBODY).ok());
                continue;
            }
            emit(&News::Account(account(&running, workers)));
        }
        stop.trigger();
    });
    let stuck = running.stop().stuck;
    emit(&News::Ended { stuck });
    Ok(())
}

/// Starts the case, without its guarantees if not all can be kept; the workers as they are then.
fn start(order: &Order, stop: &Stop) -> Result<(RunningExecutor, Vec<Worker>), Failure> {
    let mut workers = order.case.workers.clone();
    let (running, publishers) = match executor(order, &workers)? {
        Ok(started) => started,
        Err(Error::NotAdmitted { .. }) => {
            workers.iter_mut().for_each(|w| w.guaranteed = false);
            executor(order, &workers)?.map_err(Failure::refused)?
        }
        Err(e) => return Err(Failure::refused(e)),
    };
    for (publisher, every) in publishers {
        publish(publisher, every, stop);
    }
    for stranger in &order.case.strangers {
        strange(*stranger, order.cpu, stop)?;
    }
    let plan = running.report().admission.plan;
    let planned = plan.iter().flat_map(|plan| &plan.workers);
    for (worker, planned) in workers.iter_mut().zip(planned) {
        if let (true, Policy::Sporadic(params)) = (worker.guaranteed, planned.policy) {
            worker.priority = params.priority();
            (worker.budget, worker.period) = (params.budget(), params.period());
            worker.max_repl = params.max_repl();
            worker.background = match params.low() {
                Low::Background(priority) => Some(priority),
                Low::Suspend => None,
            };
        }
    }
    Ok((running, workers))
}

/// The publishers of a case, with the time from one message to the next.
type Publishers = Vec<(Publisher<Int32>, Nanos)>;
/// An executor, or why it does not start.
type Tried = Result<(RunningExecutor, Publishers), Error>;

fn executor(order: &Order, workers: &[Worker]) -> Result<Tried, Failure> {
    // Lines of the log are not shown: the parent reads what this process prints.
    let words = ["torture", "--ros-args", "--disable-stdout-logs"].map(String::from);
    let args = RosArgs::parse(words, &Environment::default()).map_err(Failure::refused)?;
    let context = Context::in_process().with_args(args);
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
    let mut publishers = Publishers::new();
    for (index, worker) in workers.iter().enumerate() {
        let group = worker.group.and_then(|g| groups.get(usize::from(g)));
        let group = group.map(|group| match worker.section() {
            // With the interrupts that hit it; a guarantee beside one without end is refused.
            Some(section) => group.clone().holds(Duration::from_nanos(section + MS)),
            None => group.clone(),
        });
        let cpu = (!order.case.unpinned).then_some(order.cpu);
        let publisher = add(&mut executor, &node, (index, worker), (cpu, group))?;
        publishers.extend(publisher);
    }
    // Threads that are not pinned begin on the CPUs of this one.
    let me = replenish_os::current_tid();
    let place = |cpu| replenish_os::set_affinity(me, &CpuSet::one(cpu)).map_err(Failure::refused);
    place(if order.case.unpinned {
        order.cpu
    } else {
        order.support
    })?;
    let started = executor.start();
    place(order.support)?;
    Ok(started.map(|running| (running, publishers)))
}

fn add(
    executor: &mut Executor,
    node: &Node,
    (index, worker): (usize, &Worker),
    (cpu, group): (Option<usize>, Option<Group>),
) -> Result<Option<(Publisher<Int32>, Nanos)>, Failure> {
    let low = worker.background.map_or(Low::Suspend, Low::Background);
    let (budget, period) = (worker.budget, worker.period);
    let params = Params::new(worker.priority, low, budget, period, worker.max_repl);
    let policy = Policy::sporadic(params.map_err(Failure::refused)?).map_err(Failure::refused)?;
    let name = case::name(index);
    let builder = executor.worker(&name).capacity(4).stack_size(128 << 10);
    let builder = if worker.guaranteed {
        let (budget, period) = (Duration::from_nanos(budget), Duration::from_nanos(period));
        builder.guarantee(Guarantee::of(budget).every(period))
    } else {
        builder.policy(policy)
    };
    let builder = match cpu {
        Some(cpu) => builder.cpu(cpu),
        None => builder,
    };
    let logger = worker.awaits.then(|| node.logger());
    let mut publishes = None;
    let often = Duration::from_millis(1);
    let builder = match (worker.work, logger) {
        (Work::Periodic { every, burn }, Some(logger)) => builder
            .timer_async(Duration::from_nanos(every), move || {
                round(logger.clone(), burn, every / 8)
            }),
        (Work::Sleepy { burn, sleep }, Some(logger)) => builder.task(rounds(logger, burn, sleep)),
        (Work::Endless, _) => builder.timer(often, |cx| while !cx.is_stopping() {}),
        (Work::BackToBack { burn }, _) => builder.timer(often, move |cx| burn_for(burn, cx)),
        (Work::Periodic { every, burn }, _) => {
            builder.timer(Duration::from_nanos(every), move |cx| burn_for(burn, cx))
        }
        (Work::Sleepy { burn, sleep }, _) => builder.timer(often, move |cx| {
            while !cx.is_stopping() {
                burn_for(burn, cx);
                std::thread::sleep(Duration::from_nanos(sleep));
            }
        }),
        (Work::Messages { every, burn }, _) => {
            let publisher = node.publisher::<Int32>(&name, Qos::reliable());
            publishes = Some((publisher.map_err(Failure::refused)?, every));
            let topic = name.as_str();
            builder.subscribe(node, topic, Qos::reliable(), move |_: &Int32, cx| {
                burn_for(burn, cx);
            })
        }
    };
    let mut builder = builder.map_err(Failure::refused)?;
    if let Some(group) = &group {
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
    Ok(publishes)
}

/// Says so, waits, and consumes so much CPU time.
async fn round(logger: Logger, burn: Nanos, sleep: Nanos) {
    log_info!(logger, "burns {burn} ns after a sleep of {sleep} ns");
    replenish::sleep(Duration::from_nanos(sleep)).await;
    burn_unless(burn, || false);
}

/// Such rounds without end.
async fn rounds(logger: Logger, burn: Nanos, sleep: Nanos) {
    for _ in 0..u64::MAX {
        round(logger.clone(), burn, sleep).await;
    }
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

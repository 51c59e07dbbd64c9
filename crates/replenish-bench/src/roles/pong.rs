//! Pong: answers two topics, each on its own worker with its own scheduling.
//!
//! Answering takes CPU time (and, in Experiment 2, sleep). With a grid, a callback that starts
//! outside a window returns at once, and one that the end of its window catches gives up: so a
//! backlog is discarded, and what is answered was done inside the window.

use super::cpu_trace::CpuTrace;
use super::link;
use super::protocol::{Event, Mode, Overrun, PongEnd, Ready, ThreadRow};
use super::supervised::{self, SharedGrid};
use super::timing::Timing;
use crate::load::Nanos;
use crate::load::burn::burn;
use crate::load::grid::{Grid, Place, place_of, window_of};
use crate::load::simulated::Costs;
use crate::load::spec::{
    DISPATCHER_PRIORITY, ENFORCER_PRIORITY, HIGH_PRIORITY, High, LOW_PRIORITY, MAX_REPL, Spec,
};
use replenish::msg::std_msgs::Int32;
use replenish::{CallbackContext, Context, Executor, Publisher, Qos, Report, RunningExecutor};
use replenish_cli::machine;
use replenish_cli::outcome::Failure;
use replenish_cli::threads;
use replenish_os::{PiMutex, Policy, clock};
use sporadic::{Low, Params};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Settings of pong.
#[derive(Debug, Clone)]
pub(crate) struct Config {
    /// The agent's address.
    pub agent: SocketAddr,
    /// Scheduling and work.
    pub spec: Spec,
    /// CPU of workers, dispatcher and enforcer.
    pub cpu: Option<usize>,
    /// CPU of the thread that takes the snapshots.
    pub monitor_cpu: Option<usize>,
    /// Refuses to start without real enforcement.
    pub strict: bool,
}

/// State that a topic's callback and the monitor share.
#[derive(Debug)]
pub(crate) struct Topic {
    /// Answers published.
    pub answered: AtomicU64,
    /// CPU time that callbacks were asked to consume, in ns.
    pub burnt: AtomicU64,
    /// CPU time from the end of the work to the answer's being published, in ns.
    after_work: AtomicU64,
    /// Times at which messages were taken, and delays of sleeps.
    timing: Timing,
    /// Slices in which the worker had the CPU.
    pub cpu_trace: PiMutex<CpuTrace>,
}

impl Topic {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            answered: AtomicU64::new(0),
            burnt: AtomicU64::new(0),
            after_work: AtomicU64::new(0),
            timing: Timing::new(),
            cpu_trace: PiMutex::new(CpuTrace::new()),
        })
    }
}

/// A pong that runs.
pub(crate) struct Pong {
    /// Its executor.
    pub running: RunningExecutor,
    /// The topic with the budget.
    pub high: Arc<Topic>,
    /// The other one.
    pub low: Arc<Topic>,
    /// Mode in which budgets are held.
    pub mode: Mode,
    /// Requested policies by thread name.
    requested: Vec<(String, String)>,
}

/// Connects, creates the endpoints and starts the executor.
pub(crate) fn start(config: &Config, grid: &SharedGrid, supervised: bool) -> Result<Pong, Failure> {
    let context = link::connect(config.agent)?;
    let (high_policy, low_policy) = policies(&config.spec)?;
    let real_time = machine::privilege().real_time();
    let mut exec = Executor::new(&context);
    exec.strict(config.strict)
        .lock_memory(real_time && machine::privilege().memory_lock.is_ok())
        .enforcer_priority(ENFORCER_PRIORITY)
        .on_event(move |event| report_event(event, supervised));
    let dispatcher = fifo(DISPATCHER_PRIORITY)?;
    exec.dispatcher(dispatcher);
    if let Some(cpu) = config.cpu {
        exec.dispatcher_cpu(cpu);
    }
    let (high, low) = (Topic::new(), Topic::new());
    let spec = &config.spec;
    let mut topics = [
        ("high", &high, high_policy, spec.burst, 0),
        ("low", &low, low_policy, spec.low_burn(), spec.low_sleep()),
    ];
    let mut requested = vec![("dispatcher".to_string(), dispatcher.to_string())];
    for (name, topic, policy, cpu, sleep) in &mut topics {
        requested.push((name.to_string(), policy.to_string()));
        let answer = Answer {
            topic: Arc::clone(topic),
            cpu_trace: CpuTrace::new(),
            grid: Arc::clone(grid),
            pong: publisher(&context, name)?,
            cpu: spec.net(*cpu),
            sleep: *sleep,
        };
        add_worker(&mut exec, &context, name, *policy, config.cpu, answer)?;
    }
    let running = exec.start().map_err(Failure::refused)?;
    let mode = mode(&running.report(), real_time);
    if mode == Mode::Enforced && matches!(spec.high, High::Sporadic { .. }) {
        let name = config
            .cpu
            .map_or_else(|| "enforcer".into(), |cpu| format!("enforcer/{cpu}"));
        requested.push((name, fifo(ENFORCER_PRIORITY)?.to_string()));
    }
    Ok(Pong {
        running,
        high,
        low,
        mode,
        requested,
    })
}

fn publisher(context: &Context, name: &str) -> Result<Publisher<Int32>, Failure> {
    let node = context.node("pong").map_err(Failure::refused)?;
    node.publisher(&format!("{name}_pong"), Qos::best_effort())
        .map_err(Failure::refused)
}

fn add_worker(
    exec: &mut Executor,
    context: &Context,
    name: &str,
    policy: Policy,
    cpu: Option<usize>,
    mut answer: Answer,
) -> Result<(), Failure> {
    let node = context.node("pong").map_err(Failure::refused)?;
    let mut worker = exec.worker(name).policy(policy);
    if let Some(cpu) = cpu {
        worker = worker.cpu(cpu);
    }
    let topic = format!("{name}_ping");
    let callback = move |ping: &Int32, cx: &CallbackContext<'_>| answer.answer(ping, cx);
    worker
        .subscribe(&node, topic.as_str(), Qos::best_effort(), callback)
        .map(drop)
        .map_err(Failure::refused)
}

fn policies(spec: &Spec) -> Result<(Policy, Policy), Failure> {
    let high = match spec.high {
        High::Fifo => fifo(HIGH_PRIORITY)?,
        High::Sporadic {
            budget,
            period,
            background,
        } => {
            let low = Low::Background(background);
            Params::new(HIGH_PRIORITY, low, budget, period, MAX_REPL)
                .map(Policy::Sporadic)
                .map_err(|e| Failure::Usage(e.to_string()))?
        }
    };
    Ok((high, fifo(LOW_PRIORITY)?))
}

fn fifo(priority: u8) -> Result<Policy, Failure> {
    Policy::fifo(priority).map_err(Failure::refused)
}

fn mode(report: &Report, real_time: bool) -> Mode {
    let deferred = report
        .threads
        .iter()
        .any(|t| t.enforcement == Some(replenish_os::Enforcement::Deferred));
    if deferred || !real_time {
        Mode::Deferred
    } else {
        Mode::Enforced
    }
}

/// One topic's callback.
struct Answer {
    topic: Arc<Topic>,
    cpu_trace: CpuTrace,
    grid: SharedGrid,
    pong: Publisher<Int32>,
    cpu: Nanos,
    sleep: Nanos,
}

impl Answer {
    fn answer(
        &mut self,
        ping: &Int32,
        cx: &CallbackContext<'_>,
    ) -> Result<(), replenish::middleware::PublishError> {
        let Some(end) = self.deadline(ping.data, cx.due()) else {
            return Ok(());
        };
        let cpu_trace = &mut self.cpu_trace;
        let before = clock::thread_cpu();
        let done = burn(self.cpu, end, |now| cpu_trace.ran(now));
        let burnt = clock::thread_cpu().saturating_sub(before);
        self.topic.burnt.fetch_add(burnt, Ordering::Relaxed);
        self.topic.cpu_trace.lock().clone_from(&self.cpu_trace);
        if !done || cx.is_stopping() {
            return Ok(());
        }
        if self.sleep > 0 {
            let due = clock::monotonic().saturating_add(self.sleep).min(end);
            clock::sleep_until(due);
            let now = clock::monotonic();
            if now >= end {
                return Ok(());
            }
            self.topic.timing.woke(now.saturating_sub(due));
        }
        self.pong.publish(ping)?;
        let after = clock::thread_cpu().saturating_sub(before + burnt);
        self.topic.after_work.fetch_add(after, Ordering::Relaxed);
        self.topic.answered.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    /// Time at which work on this message, `taken` by the dispatcher, must stop; `None`: it is not
    /// to be answered at all.
    fn deadline(&self, number: i32, taken: Nanos) -> Option<Nanos> {
        let Some(grid) = self.grid.get() else {
            return Some(Nanos::MAX);
        };
        let window = window_of(number);
        if let Some(index) = window {
            let place = place_of(number);
            let after = taken.saturating_sub(grid.release(index, place));
            self.topic.timing.taken(grid, index, place, after);
        }
        match grid.locate(clock::monotonic()) {
            Place::Outside => None,
            Place::Window { end, .. } if grid.is_continuous() => Some(end),
            Place::Window { index, end } => (window == Some(index)).then_some(end),
        }
    }
}

/// Events of the executor: under the orchestrator as notes, else on standard error.
pub(crate) fn report_event(event: &replenish::Event<'_>, supervised: bool) {
    match event {
        replenish::Event::Link { up: true } => {
            link::report(true, "the agent answers again", supervised);
        }
        replenish::Event::Link { up: false } => {
            link::report(false, "the agent does not answer", supervised);
        }
        // The orchestrator knows from `Ready` and says it in one line of its own.
        replenish::Event::Fallback { .. } if supervised => {}
        _ => note(&event.to_string(), supervised),
    }
}

fn note(text: &str, supervised: bool) {
    if supervised {
        let text = text.to_string();
        supervised::emit(&Event::Note { text });
    } else {
        eprintln!("replenish: {text}");
    }
}

impl Pong {
    /// Pong's report that set-up is done.
    pub(crate) fn ready(&self) -> Ready {
        Ready {
            address: None,
            mode: Some(self.mode),
            threads: self.threads(),
        }
    }

    /// The threads with requested and granted policy.
    pub(crate) fn threads(&self) -> Vec<ThreadRow> {
        self.requested
            .iter()
            .map(|(name, policy)| threads::row("pong", name, policy))
            .collect()
    }
}

/// Average costs of a message and of an answer, over the whole life of pong.
fn costs(report: &Report, [high, low]: &[Arc<Topic>; 2]) -> Costs {
    let used = |name: &str| {
        let thread = report.thread(name);
        thread.map_or(0, |t| t.usage.cpu_high.saturating_add(t.usage.cpu_low))
    };
    let before = |name: &str, topic: &Topic| {
        let of_worker = report.handles.iter().filter(|h| h.worker == name);
        let callbacks: u64 = of_worker.map(|h| h.stats.executed).sum();
        let rest = used(name)
            .saturating_sub(topic.burnt.load(Ordering::Relaxed))
            .saturating_sub(topic.after_work.load(Ordering::Relaxed));
        rest.checked_div(callbacks).unwrap_or(0)
    };
    let after = |topic: &Topic| {
        let answered = topic.answered.load(Ordering::Relaxed);
        let after = topic.after_work.load(Ordering::Relaxed);
        after.checked_div(answered).unwrap_or(0)
    };
    let enforcers: Nanos = report.enforcers.iter().map(|e| e.cpu).sum();
    let support = used("dispatcher").saturating_add(enforcers);
    Costs {
        dispatch: support.checked_div(report.dispatcher.samples).unwrap_or(0),
        high: before("high", high).saturating_add(after(high)),
        low: before("low", low),
        low_after: after(low),
        wake_up: low.timing.wake_up(),
    }
}

/// The last words of pong about its topics high and low; `grid` is what its windows were.
pub(crate) fn end(report: &Report, topics: &[Arc<Topic>; 2], grid: Option<&Grid>) -> PongEnd {
    let arrivals = |topic: &Topic| grid.map(|g| topic.timing.arrivals(g)).unwrap_or_default();
    let us = |ns: i64| ns as f64 / 1e3;
    let overruns = report
        .threads
        .iter()
        .find(|t| t.name == "high")
        .map(|t| t.overruns);
    PongEnd {
        overrun_us: overruns.map_or_else(Overrun::default, |o| Overrun {
            median: us(o.median),
            p99: us(o.p99),
            count: o.count,
            stall_count: o.stalls,
            stalls: o.worst_stall.map(|s| us(s.overrun)).into_iter().collect(),
        }),
        costs: costs(report, topics),
        arrivals_high: arrivals(&topics[0]),
        arrivals_low: arrivals(&topics[1]),
        dropped: report
            .handles
            .iter()
            .map(|h| h.stats.dropped + h.stats.lost)
            .sum(),
        stuck: report.stuck.clone(),
    }
}

//! One window of the isolation experiment: an executor with a control loop and two other workers on
//! one CPU, of which one misbehaves from a certain time on.
//!
//! ```text
//!   epoch            + CALM                                   + WINDOW
//!     │ all behave      │ the case's disturbance                 │ end: everything stops
//!     ├─────────────────┼────────────────────────────────────────┤
//!     ▲ ▲ ▲ ▲ releases of the control loop, each due within its period
//! ```
//!
//! With and without budgets the workers do the same work on the same CPU, and the control loop is
//! the least urgent of the three, as its period is the longest. Without budgets they are FIFO
//! threads; with budgets each has a guarantee, and the planner chooses the rest.

use crate::load::burn::burn;
use crate::load::{MS, Nanos};
use crate::testbench::probe;
use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, Every, Executor, Guarantee, Overrun, Policy, Publisher, Qos,
    RunningExecutor, WorkerBuilder,
};
use replenish_cli::machine;
use replenish_cli::outcome::Failure;
use replenish_os::{Enforcement, PiMutex, ThreadSpec, clock, spawn};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// Period and deadline of the control loop.
pub(super) const PERIOD: Nanos = 10 * MS;
/// CPU time of one round of the control loop.
const CONTROL: Nanos = 2 * MS;
/// Period of the neighbour, and of the messages while all is calm.
const NEIGHBOUR: Nanos = 5 * MS;
/// Time in which no neighbour disturbs, in ns.
pub(super) const CALM: Nanos = 100 * MS;
/// From the epoch to the end.
pub(super) const WINDOW: Nanos = 500 * MS;

/// The disturbance of the control loop in one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Disturbance {
    /// No disturbance: the three workers as they are meant to be.
    None,
    /// The neighbour needs nearly five times as much as it is meant to: 4.8 ms every 5 ms.
    NoisyNeighbour,
    /// The neighbour's callback does not return.
    RunawayCallback,
    /// A sender publishes as fast as it can on a best-effort topic.
    MessageFlood,
}

impl Disturbance {
    /// All of them, in the order of the report.
    pub(super) const ALL: [Self; 4] = [
        Self::None,
        Self::NoisyNeighbour,
        Self::RunawayCallback,
        Self::MessageFlood,
    ];

    /// Its name for people.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::None => "Everybody behaves",
            Self::NoisyNeighbour => "Noisy neighbour: 4.8 ms instead of 1 ms",
            Self::RunawayCallback => "Runaway: a callback does not return",
            Self::MessageFlood => "Flood: messages without pause",
        }
    }

    /// Its name in the JSON.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "alone",
            Self::NoisyNeighbour => "noisy-neighbour",
            Self::RunawayCallback => "runaway-callback",
            Self::MessageFlood => "message-flood",
        }
    }
}

/// The response to one release of the control loop. Times in ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Response {
    /// Its release, counted from the epoch.
    pub(super) release: Nanos,
    /// From its release to its end; if it did not end, to the end of the window.
    pub(super) took: Nanos,
    /// Whether it ended.
    pub(super) ended: bool,
}

/// One window.
#[derive(Debug, Clone)]
pub(super) struct Window {
    pub(super) responses: Vec<Response>,
    /// The longest time that the machine stood still for the probe.
    pub(super) stall: Nanos,
    /// CPU time that the hypervisor says it took meanwhile, in steps of 10 ms.
    pub(super) stolen: Nanos,
    /// Messages that the sender offered.
    pub(super) sent: u64,
    /// Whether budgets were held at callback boundaries only.
    pub(super) deferred: bool,
    /// Requests of the executor that the machine did not grant.
    pub(super) fallbacks: Vec<String>,
}

/// State that the callbacks share.
struct Shared {
    disturbance: Disturbance,
    /// Time at which the disturbance begins; `MAX` until known.
    begins: AtomicU64,
    /// Time at which everything stops; `MAX` until known.
    ends: AtomicU64,
    /// Until then a callback that runs away does not return, and looks at nothing else.
    let_go: AtomicBool,
    /// (release, end) of the control loop, on the monotonic clock.
    rounds: PiMutex<Vec<(Nanos, Nanos)>>,
}

impl Shared {
    fn is_disturbed(&self, by: Disturbance) -> bool {
        self.disturbance == by && clock::monotonic() >= self.begins.load(Ordering::Relaxed)
    }

    fn ends(&self) -> Nanos {
        self.ends.load(Ordering::Relaxed)
    }
}

/// Runs one window.
pub(super) fn run(
    disturbance: Disturbance,
    budgets: bool,
    cpu: usize,
    support: usize,
) -> Result<Window, Failure> {
    let shared = Arc::new(Shared {
        disturbance,
        begins: AtomicU64::new(Nanos::MAX),
        ends: AtomicU64::new(Nanos::MAX),
        let_go: AtomicBool::new(false),
        rounds: PiMutex::new(Vec::with_capacity(1_000)),
    });
    let context = Context::in_process();
    let running = start(&context, &shared, budgets, cpu)?;
    let probe = probe::start(cpu)?;
    let taken = || replenish_os::steal_time(cpu).unwrap_or(0);
    let before = taken();
    let epoch = clock::monotonic() + 20 * MS;
    let end = epoch + WINDOW;
    shared.begins.store(epoch + CALM, Ordering::Relaxed);
    shared.ends.store(end, Ordering::Relaxed);
    let sender = sender(&context, &shared, epoch, support)?;
    clock::sleep_until(end);
    let stall = probe.stop();
    let stolen = taken().saturating_sub(before);
    // Only now, after everything was measured, so that the executor can be stopped.
    shared.let_go.store(true, Ordering::Relaxed);
    let sent = sender.join().unwrap_or(0);
    let report = running.stop();
    let deferred = report
        .threads
        .iter()
        .any(|t| t.enforcement == Some(Enforcement::Deferred));
    let rounds = shared.rounds.lock().clone();
    Ok(Window {
        responses: responses(&rounds, epoch, end),
        stall,
        stolen,
        sent,
        deferred: deferred || !machine::privilege().real_time(),
        fallbacks: report.fallbacks,
    })
}

fn start(
    context: &Context,
    shared: &Arc<Shared>,
    budgets: bool,
    cpu: usize,
) -> Result<RunningExecutor, Failure> {
    let node = context.node("robot").map_err(Failure::refused)?;
    let mut exec = Executor::new(context);
    exec.dispatcher_cpu(cpu)
        .no_ledger()
        .lock_memory(machine::privilege().real_time() && machine::privilege().memory_lock.is_ok())
        .on_event(|_| ()); // what was not granted is in the report
    let ms = |ms: f64| Duration::from_secs_f64(ms / 1e3);
    let needs = [
        ("neighbour", Guarantee::of(ms(1.2)).every(ms(5.0)), 62),
        ("telemetry", Guarantee::of(ms(0.5)).every(ms(5.0)), 61),
        ("control", Guarantee::at(100.0).taking(ms(2.5)), 60),
    ];
    if !budgets {
        exec.dispatcher(fifo(98)?);
    }
    for (name, guarantee, priority) in needs {
        let mut worker = exec.worker(name).cpu(cpu);
        worker = if budgets {
            worker.guarantee(guarantee)
        } else {
            worker.policy(fifo(priority)?)
        };
        let added = match name {
            "neighbour" => neighbour(worker, shared),
            "control" => control(worker, shared),
            _ => {
                let ends = Arc::clone(shared);
                worker.subscribe(
                    &node,
                    "telemetry",
                    Qos::best_effort(),
                    move |_: &Int32, _: &CallbackContext<'_>| {
                        burn(MS / 10, ends.ends(), |_| ());
                    },
                )
            }
        };
        added.map(drop).map_err(Failure::refused)?;
    }
    exec.start().map_err(Failure::refused)
}

fn fifo(priority: u8) -> Result<Policy, Failure> {
    Policy::fifo(priority).map_err(Failure::refused)
}

fn control<'e>(
    worker: WorkerBuilder<'e>,
    shared: &Arc<Shared>,
) -> Result<WorkerBuilder<'e>, replenish::Error> {
    let shared = Arc::clone(shared);
    let every = Every::period(Duration::from_nanos(PERIOD)).overrun(Overrun::CatchUp);
    worker.timer(every, move |cx: &CallbackContext<'_>| {
        if burn(CONTROL, shared.ends(), |_| ()) {
            let mut rounds = shared.rounds.lock();
            if rounds.len() < rounds.capacity() {
                rounds.push((cx.due(), clock::monotonic()));
            }
        }
    })
}

fn neighbour<'e>(
    worker: WorkerBuilder<'e>,
    shared: &Arc<Shared>,
) -> Result<WorkerBuilder<'e>, replenish::Error> {
    let shared = Arc::clone(shared);
    worker.timer(
        Duration::from_nanos(NEIGHBOUR),
        move |_: &CallbackContext<'_>| {
            if shared.is_disturbed(Disturbance::RunawayCallback) {
                while !shared.let_go.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
                return;
            }
            let work = if shared.is_disturbed(Disturbance::NoisyNeighbour) {
                48 * MS / 10
            } else {
                MS
            };
            burn(work, shared.ends(), |_| ());
        },
    )
}

/// Publishes a message every 5 ms or, in a flood, without pause, from another CPU; an ordinary
/// thread.
fn sender(
    context: &Context,
    shared: &Arc<Shared>,
    epoch: Nanos,
    cpu: usize,
) -> Result<replenish_os::Thread<u64>, Failure> {
    let node = context.node("sender").map_err(Failure::refused)?;
    let publisher: Publisher<Int32> = node
        .publisher("telemetry", Qos::best_effort())
        .map_err(Failure::refused)?;
    let shared = Arc::clone(shared);
    let spec = ThreadSpec::new("sender").cpu(cpu);
    spawn(spec, move || {
        let (mut sent, mut next) = (0, epoch);
        while clock::monotonic() < shared.ends() {
            if !shared.is_disturbed(Disturbance::MessageFlood) {
                clock::sleep_until(next);
                next += NEIGHBOUR;
            }
            // A flood may find the way blocked; that is what best effort means.
            publisher.publish(&Int32 { data: 0 }).ok();
            sent += 1;
        }
        sent
    })
    .map_err(Failure::refused)
}

/// Every release that was due within the window, ended or not.
fn responses(rounds: &[(Nanos, Nanos)], epoch: Nanos, end: Nanos) -> Vec<Response> {
    let Some(&(first, _)) = rounds.first() else {
        return Vec::new();
    };
    let mut ended = rounds.iter().peekable();
    let mut responses = Vec::new();
    let mut release = first;
    while release + PERIOD <= end {
        while ended.peek().is_some_and(|(due, _)| *due < release) {
            ended.next();
        }
        let done = ended.peek().filter(|(due, _)| *due == release);
        if release >= epoch {
            responses.push(Response {
                release: release - epoch,
                took: done.map_or(end, |(_, at)| *at) - release,
                ended: done.is_some(),
            });
        }
        release += PERIOD;
    }
    responses
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_did_not_end_counts_with_the_time_it_has_waited() {
        let at = |ms: Nanos| ms * MS;
        let rounds = [(at(5), at(8)), (at(15), at(18)), (at(35), at(60))];
        let got = responses(&rounds, at(10), at(70));
        let expected = [
            (5, 3, true),
            (15, 45, false),
            (25, 25, true),
            (35, 25, false),
            (45, 15, false),
        ];
        let expected = expected.map(|(release, took, ended)| Response {
            release: at(release),
            took: at(took),
            ended,
        });
        assert_eq!(got, expected);
        assert!(responses(&[], 0, at(70)).is_empty());
    }
}

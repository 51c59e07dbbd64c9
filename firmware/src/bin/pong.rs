//! Pong over a serial line: executor, XRCE client, USART2. The host's agent and ping are at the
//! other end; the board tells them the time.
//!
//! ```text
//!   board, every 10 ms:  tick ──► host's ping: high_ping, low_ping ──► high, low: a burst each
//!                        host's ping counts ◄── high_pong, low_pong ◄──┘
//! ```
//!
//! Ticks below 0 rehearse until the host answers; tick n >= 0 is message n of both topics. The
//! workers are those of the command line ([`firmware::options`]): the first answers topic high, the
//! last, without a budget, topic low, and any between them topic high as well.
#![no_std]
#![no_main]

extern crate alloc;

use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use firmware::answer::{Answer, Count, Scene};
use firmware::options::{self, Options};
use firmware::shared_port::SharedPort;
use firmware::uart::Usart2;
use firmware::work::Burst;
use firmware::{console, line, say, time, uart};
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Error, Event, Executor, Policy, Publisher, Qos, RunningExecutor};
use replenish_os::freertos::{SealedHeap, TaskUse, panicked, start, tasks};
use replenish_os::{ThreadSpec, Usage, clock, spawn};

#[global_allocator]
static HEAP: SealedHeap<{ 108 * 1024 }> = SealedHeap::new();

const MS: u64 = 1_000_000;
/// Between two ticks, in ns.
const INTERVAL: u64 = 10 * MS;
/// Above the workers, so that it ends the measurement on time.
const MAIN: u8 = 97;
/// The longest that is waited for another agent, in ns.
const LONGEST_GAP: u64 = 300_000 * MS;
/// The task that sends the ticks.
const CLOCK: u8 = 96;

/// Keeps the board busy while it waits for the host at set-up: virtual time would jump.
static AWAKE: AtomicBool = AtomicBool::new(true);
static LINK_LOST: AtomicU32 = AtomicU32::new(0);
static LINK_BACK: AtomicU32 = AtomicU32::new(0);
static UNSENT: AtomicU32 = AtomicU32::new(0);
/// Ticks between the end of the agent and the first answers after its return; 0: there is no such
/// gap.
static GAP: AtomicU32 = AtomicU32::new(0);
static OVER: AtomicBool = AtomicBool::new(false);

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(MAIN, 16384, || {
        let mut line = [0_u8; 256];
        match options::read(console::command_line(&mut line)) {
            Ok(options) => {
                if let Err(e) = run(&options) {
                    say!("{e}");
                    console::exit(false)
                }
                console::exit(panicked().count == 0 && HEAP.usage().refused == 0)
            }
            Err(what) => {
                say!("the command line was not understood: {what}");
                console::exit(false)
            }
        }
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

/// A worker while it runs.
struct Running {
    name: &'static str,
    count: Arc<Count>,
    before: Usage,
    /// Answers when the agent was ended, and when the link was up again.
    marks: Arc<[AtomicU32; 2]>,
}

fn run(options: &Options) -> Result<(), Error> {
    let burst = Burst::calibrate();
    stay_awake();
    let config = XrceConfig {
        key: Some(*b"pong"),
        connect_timeout: 600_000 * MS, // virtual: the emulator may be fast
        request_timeout: 60_000 * MS,
        ..XrceConfig::small()
    };
    let port = SharedPort::new(Usart2::start(options.baud), config.mtu);
    let frames = port.clone();
    let context = Context::new(Xrce::over("the agent", port, config)?);
    let node = context.node("pong")?;
    let tick = node.publisher::<Int32>("tick", Qos::best_effort())?;
    let mut exec = Executor::new(&context);
    exec.on_event(told);
    let scene = Arc::new(Scene::default());
    let mut workers = Vec::new();
    // One publisher for all workers of a topic: a session has 32 objects.
    let pongs = [
        Arc::new(node.publisher::<Int32>("high_pong", Qos::best_effort())?),
        Arc::new(node.publisher::<Int32>("low_pong", Qos::best_effort())?),
    ];
    let last = options.case.workers.len() - 1;
    for (i, worker) in options.case.workers.iter().enumerate() {
        let name = ["high", "high2", "high3", "high4", "high5", "high6", "high7"]
            .get(i)
            .filter(|_| i < last)
            .unwrap_or(&"low");
        let ping = if i < last { "high_ping" } else { "low_ping" };
        let sleep = if worker.budget == 0 { options.sleep } else { 0 };
        let ns = options.burst * MS;
        let count = Arc::new(Count::default());
        let mut answer = Answer {
            worker: *worker,
            count: Arc::clone(&count),
            scene: Arc::clone(&scene),
            pong: Arc::clone(if i < last { &pongs[0] } else { &pongs[1] }),
            burst,
            cpu: ns * (100 - sleep) / 100,
            sleep: ns * sleep / 100,
            target: None,
        };
        let policy = match worker.params() {
            Some(params) => Policy::Sporadic(params),
            None => Policy::fifo(worker.priority)?,
        };
        exec.worker(name)
            .policy(policy)
            .stack_size(4096)
            .subscribe(&node, ping, Qos::best_effort(), move |ping: &Int32, _| {
                answer.answer(ping)
            })?;
        workers.push(Running {
            name,
            count,
            before: Usage::default(),
            marks: Arc::default(),
        });
    }
    let running = exec.start()?;
    let answers = workers.len() as u32 + options.flood;
    rehearse(&tick, &workers);
    // With whole budgets: what the rehearsal has used comes back piece by piece, a period later.
    let longest = options.case.workers.iter().map(|w| w.period).max();
    clock::sleep_until(clock::monotonic() + longest.unwrap_or(0) + INTERVAL);
    line::disturb(options.noise);
    if options.lockstep {
        AWAKE.store(false, Ordering::SeqCst);
    }
    let idle_before: Vec<TaskUse> = tasks().collect();
    send_ticks(tick, options, answers, Restart::of(&workers));
    scene.begin.wait();
    let begun = scene.begun.load(Ordering::SeqCst);
    for w in &mut workers {
        w.before = running.usage(w.name).unwrap_or_default();
    }
    HEAP.seal();
    clock::sleep_until(begun + options.case.length);
    if options.restart > 0 {
        wait_for_return(begun + options.case.length);
    }
    let elapsed = clock::monotonic() - begun;
    report(options, &running, &workers, elapsed);
    report_tasks(&idle_before);
    let frames = frames.stats();
    say!(
        "\"frames\": {{\"delivered\": {}, \"damaged\": {}}}}}",
        frames.delivered,
        frames.damaged,
    );
    OVER.store(true, Ordering::SeqCst);
    AWAKE.store(true, Ordering::SeqCst);
    // The host must see the last answers before the emulator ends: one more tick and its answer.
    clock::sleep_until(clock::monotonic() + 100 * MS);
    core::mem::forget(running);
    Ok(())
}

/// Ends as much later than `end` as the agent was away: that is as long as the host makes it.
fn wait_for_return(end: u64) {
    let mut now = end;
    while now < end + LONGEST_GAP {
        let gap = u64::from(GAP.load(Ordering::SeqCst)) * INTERVAL;
        if gap > 0 && now >= end + gap {
            return;
        }
        now = if gap > 0 { end + gap } else { now + 100 * MS };
        clock::sleep_until(now);
    }
}

fn told(event: &Event<'_>) {
    match event {
        Event::Link { up: true } => LINK_BACK.fetch_add(1, Ordering::Relaxed),
        Event::Link { up: false } => LINK_LOST.fetch_add(1, Ordering::Relaxed),
        _ => 0,
    };
    say!("# {event}"); // the host reads of the link here
}

/// A task below all others that is never idle while its flag is set.
fn stay_awake() {
    let spec = ThreadSpec::new("awake")
        .policy(Policy::fifo(1).unwrap_or_default())
        .stack_size(1024);
    let body = || {
        while AWAKE.load(Ordering::Relaxed) {
            core::hint::black_box(());
        }
    };
    if let Err(e) = spawn(spec, body) {
        say!("no task: {e}");
        console::exit(false)
    }
}

/// Ticks below 0, until the host has answered on every topic, and then until it has answered the
/// last of them: a message that came later would take something of a budget with which the run is
/// to begin.
fn rehearse(tick: &Publisher<Int32>, workers: &[Running]) {
    let latest = |w: &Running| w.count.rehearsed.load(Ordering::Relaxed);
    let send = |data| tick.publish(&Int32 { data }).ok();
    let (mut last, mut more) = (0, 30);
    while more > 0 {
        last -= 1;
        let _ = send(last);
        clock::sleep_until(clock::monotonic() + INTERVAL);
        if workers.iter().all(|w| latest(w) < 0) {
            more -= 1;
            clock::sleep_until(clock::monotonic() + INTERVAL);
        }
    }
    let mut patience = 0;
    while !workers.iter().all(|w| latest(w) == last) {
        patience += 1;
        if patience % 200 == 0 {
            last -= 1; // the last may have been lost
            let _ = send(last);
        }
        clock::sleep_until(clock::monotonic() + INTERVAL);
    }
}

/// Each worker's answers at the marks that the clock sets around a restart of the agent.
struct Restart(Vec<(Arc<Count>, Arc<[AtomicU32; 2]>)>);

impl Restart {
    fn of(workers: &[Running]) -> Self {
        let both = |w: &Running| (Arc::clone(&w.count), Arc::clone(&w.marks));
        Self(workers.iter().map(both).collect())
    }

    /// Whether every worker has answered since.
    fn all_answered_since(&self, mark: usize) -> bool {
        let more = |(count, marks): &(Arc<Count>, Arc<[AtomicU32; 2]>)| {
            count.answered.load(Ordering::Relaxed) > marks[mark].load(Ordering::Relaxed)
        };
        self.0.iter().all(more)
    }

    /// Notes what was answered so far.
    fn note(&self, mark: usize) {
        for (count, marks) in &self.0 {
            marks[mark].store(count.answered.load(Ordering::Relaxed), Ordering::Relaxed);
        }
    }
}

/// The task that tells the host the time.
fn send_ticks(tick: Publisher<Int32>, options: &Options, answers: u32, noted: Restart) {
    let restart = i32::try_from(options.restart * MS / INTERVAL).unwrap_or(0);
    let wanted = options.lockstep;
    let mut lockstep = wanted;
    let send = move |data, lockstep| {
        if tick.publish(&Int32 { data }).is_err() {
            UNSENT.fetch_add(1, Ordering::Relaxed);
        } else if lockstep {
            line::expect(answers);
        }
    };
    let body = move || {
        let mut next = clock::monotonic();
        let (mut back, mut over) = (false, false);
        for n in 0.. {
            next += INTERVAL;
            clock::sleep_until(next);
            // A tick exists in emulation only: it costs the board no time, from here to the next
            // wait.
            time::stand_still_until_waiting(|| {
                over = OVER.load(Ordering::SeqCst);
                if over {
                    return send(-2, lockstep);
                }
                if restart > 0 && n == restart {
                    AWAKE.store(true, Ordering::SeqCst);
                    lockstep = false;
                    noted.note(0);
                    say!("# end the agent");
                }
                if !back && LINK_BACK.load(Ordering::Relaxed) > 0 {
                    back = true;
                    noted.note(1);
                }
                // Ping, too, has to log in again, in the host's time.
                if back && GAP.load(Ordering::SeqCst) == 0 && noted.all_answered_since(1) {
                    lockstep = wanted;
                    AWAKE.store(!lockstep, Ordering::SeqCst);
                    GAP.store((n - restart) as u32, Ordering::SeqCst);
                }
                send(n, lockstep);
            });
            if over {
                return;
            }
        }
    };
    let spec = ThreadSpec::new("clock")
        .policy(Policy::fifo(CLOCK).unwrap_or_default())
        .stack_size(3072);
    if let Err(e) = spawn(spec, body) {
        say!("no task: {e}");
        console::exit(false)
    }
}

/// Prints what each task has used since the run began, of CPU time and of its stack.
fn report_tasks(before: &[TaskUse]) {
    say!("\"tasks\": [");
    for (i, task) in tasks().enumerate() {
        let comma = if i > 0 { "," } else { "" };
        let was = before.iter().find(|b| b.tid == task.tid);
        say!(
            "{comma}{{\"name\": \"{}\", \"cpu_ns\": {}, \"stack_bytes\": {}, \"stack_unused\": {}, \"switches\": {}}}",
            task.name,
            task.cpu - was.map_or(0, |w| w.cpu),
            task.stack_bytes,
            task.stack_unused,
            (task.blocks + task.preemptions)
                .wrapping_sub(was.map_or(0, |w| w.blocks + w.preemptions)),
        );
    }
    say!("],");
}

/// Prints all but the end.
fn report(options: &Options, running: &RunningExecutor, workers: &[Running], elapsed: u64) {
    say!(
        "{{\"elapsed_ns\": {elapsed}, \"baud\": {}, \"workers\": [",
        options.baud
    );
    for (i, (w, asked)) in workers.iter().zip(&options.case.workers).enumerate() {
        let comma = if i + 1 < workers.len() { "," } else { "" };
        let usage = running.usage(w.name).unwrap_or_default();
        say!(
            "{{\"name\": \"{}\", \"priority\": {}, \"budget_ms\": {}, \"period_ms\": {}, \"offset_ms\": {}, \
             \"answered\": {}, \"answered_before_end\": {}, \"answered_until_back\": {}, \"failed\": {}, \"cpu_high_ns\": {}, \"cpu_low_ns\": {}, \"exhaustions\": {}}}{comma}",
            w.name,
            asked.priority,
            asked.budget / MS,
            asked.period / MS,
            asked.offset / MS,
            w.count.answered.load(Ordering::Relaxed),
            w.marks[0].load(Ordering::Relaxed),
            w.marks[1].load(Ordering::Relaxed),
            w.count.failed.load(Ordering::Relaxed),
            usage.cpu_high - w.before.cpu_high,
            usage.cpu_low - w.before.cpu_low,
            usage.exhaustions - w.before.exhaustions,
        );
    }
    let (port, line, heap) = (uart::counts(), line::counts(), HEAP.usage());
    say!(
        "], \"gap_ms\": {}, \"ticks_unsent\": {}, \"link_lost\": {}, \"link_back\": {}, \
         \"heap_used\": {}, \"heap_refused\": {},",
        u64::from(GAP.load(Ordering::Relaxed)) * INTERVAL / MS,
        UNSENT.load(Ordering::Relaxed),
        LINK_LOST.load(Ordering::Relaxed),
        LINK_BACK.load(Ordering::Relaxed),
        heap.used,
        heap.refused,
    );
    say!(
        "\"uart\": {{\"received\": {}, \"sent\": {}, \"overruns\": {}, \"disturbed\": {}, \"misframed\": {}, \
         \"dropped\": {}, \"damaged_on_purpose\": {}, \"unanswered\": {}}},",
        port.received,
        port.sent,
        port.overruns,
        port.disturbed,
        port.misframed,
        port.dropped,
        line.damaged,
        line.unanswered,
    );
}

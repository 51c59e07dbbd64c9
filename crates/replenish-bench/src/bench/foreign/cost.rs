//! `bench foreign cost`: the enforcer's CPU time per foreign thread, next to one of ours.
//!
//! The same work in both: threads with a budget of 2 ms in every 20 each, on one CPU. "waits": half
//! a millisecond in every 20 ms, so that the budget never ends. "exhausts": all that there is.

use super::adopted::Adopted;
use super::options::Options;
use super::program::{Program, Workshop};
use crate::load::{MS, Nanos};
use replenish_cli::lock;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::table::Table;
use replenish_os::clock::ThreadCpuClock;
use replenish_os::{
    Enforcer, EnforcerConfig, Policy, SchedClass, Thread, ThreadSpec, clock, spawn,
};
use sporadic::{Kind, Low, Params};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const THREADS: usize = 8;
const BUDGET: Nanos = 2 * MS;
const PERIOD: Nanos = 20 * MS;
/// The work of a thread that waits.
const BUSY: Nanos = MS / 2;
const WINDOW: Nanos = 2_000 * MS;
const PRIORITY: u8 = 50;

/// CPU time of an enforcer, how often it woke, and for how long.
#[derive(Debug, Default, Clone, Copy)]
struct Cost {
    cpu: Nanos,
    wakes: u64,
    time: Nanos,
}

impl Cost {
    fn add(&mut self, more: Self) {
        self.cpu += more.cpu;
        self.wakes += more.wakes;
        self.time += more.time;
    }

    /// Per thread and second: microseconds of CPU time, and wake-ups.
    fn per_thread(&self) -> (f64, f64) {
        let seconds = self.time as f64 / 1e9 * THREADS as f64;
        let seconds = seconds.max(1e-9);
        (self.cpu as f64 / 1e3 / seconds, self.wakes as f64 / seconds)
    }
}

/// `bench foreign cost`.
pub(super) fn run(options: &Options) -> Outcome {
    let cpu = options.cpus()?.measured;
    let _alone = lock::acquire()?;
    let workshop = Workshop::new()?;
    let work = workshop.c("work", include_str!("programs/work.c"))?;
    let mut table = Table::new(&["load", "threads", "CPU us/s per thread", "wakes/s", "ratio"]);
    let mut json = Vec::new();
    for (load, busy) in [("waits", Some(BUSY)), ("exhausts", None)] {
        let (mut own, mut foreign) = (Cost::default(), Cost::default());
        for _ in 0..options.windows {
            own.add(ours(cpu, busy)?);
            let mut command = Command::new(&work);
            command.arg(THREADS.to_string());
            if let Some(busy) = busy {
                command.args([busy / 1000, PERIOD / 1000].map(|us| us.to_string()));
            }
            foreign.add(theirs(&workshop, &mut command, cpu)?);
        }
        let ((own_us, own_wakes), (us, wakes)) = (own.per_thread(), foreign.per_thread());
        let ratio = us / own_us.max(1e-9);
        for (whose, us, wakes, ratio) in [
            ("ours", own_us, own_wakes, String::new()),
            ("foreign", us, wakes, format!("{ratio:.2}")),
        ] {
            let (us, wakes) = (format!("{us:.1}"), format!("{wakes:.1}"));
            table.row([load.to_owned(), whose.into(), us, wakes, ratio]);
        }
        json.push(serde_json::json!({
            "load": load, "ours_us_per_s": own_us, "foreign_us_per_s": us, "ratio": ratio,
            "ours_wakes_per_s": own_wakes, "foreign_wakes_per_s": wakes,
        }));
    }
    println!("{}", table.to_text());
    options.write("bench-foreign-cost", &serde_json::json!({ "cases": json }))
}

/// Threads of a foreign program, with one budget each.
fn theirs(workshop: &Workshop, command: &mut Command, cpu: usize) -> Result<Cost, Failure> {
    let program = Program::start(command, cpu, SchedClass::Other)?;
    let rules = (0..THREADS).map(|n| format!("work{n}=2ms/20ms@{PRIORITY}"));
    let rules = rules.collect::<Vec<_>>().join(",");
    let adopted = Adopted::start(workshop, &[&program], cpu, &["--thread", &rules])?;
    clock::sleep_until(clock::monotonic() + WINDOW);
    let report = adopted.finish()?;
    let of = |name: &str| {
        let value = report.get(name).and_then(serde_json::Value::as_u64);
        value.ok_or_else(|| Failure::refused(format!("no {name} in the report")))
    };
    Ok(Cost {
        cpu: of("enforcer_ns")?,
        wakes: of("enforcer_wakes")?,
        time: of("elapsed_ns")?,
    })
}

/// Threads of this process, as workers of an executor are enrolled.
fn ours(cpu: usize, busy: Option<Nanos>) -> Result<Cost, Failure> {
    let params = Params::new(PRIORITY, Low::Background(0), BUDGET, PERIOD, 16);
    let params = params.map_err(Failure::refused)?;
    let config = EnforcerConfig {
        capacity: THREADS,
        ..EnforcerConfig::on_cpu(cpu)
    };
    let enforcer = Enforcer::start(config).map_err(Failure::refused)?;
    let stop = Arc::<AtomicBool>::default();
    let mut threads: Vec<Thread<Result<(), String>>> = Vec::new();
    for n in 0..THREADS {
        let policy = Policy::fifo(PRIORITY).map_err(Failure::refused)?;
        let spec = ThreadSpec::new(format!("work{n}")).policy(policy).cpu(cpu);
        let (enforcer, stop) = (Arc::clone(&enforcer), Arc::clone(&stop));
        let body = move || work(&enforcer, &params, busy, &stop);
        threads.push(spawn(spec, body).map_err(Failure::refused)?);
    }
    let begin = clock::monotonic();
    clock::sleep_until(begin + WINDOW);
    let stats = enforcer.stats();
    let time = clock::monotonic().saturating_sub(begin);
    stop.store(true, Ordering::Relaxed);
    for thread in threads {
        let ended = thread
            .join()
            .map_err(|_| Failure::refused("a worker panicked"))?;
        ended.map_err(Failure::refused)?;
    }
    enforcer.stop();
    Ok(Cost {
        cpu: stats.cpu,
        wakes: stats.wakes,
        time,
    })
}

fn work(
    enforcer: &Arc<Enforcer>,
    params: &Params,
    busy: Option<Nanos>,
    stop: &AtomicBool,
) -> Result<(), String> {
    let account = enforcer.enroll(params, Kind::Corrected);
    let mut account = account.map_err(|e| e.to_string())?;
    let cpu = ThreadCpuClock::of(replenish_os::current_tid());
    let mut due = clock::monotonic();
    while !stop.load(Ordering::Relaxed) {
        account.activate(due);
        if account.callback_begin().is_err() {
            break; // the enforcer has stopped
        }
        let begin = cpu.read().unwrap_or(0);
        let wanted = busy.unwrap_or(WINDOW);
        while cpu.read().unwrap_or(0) < begin + wanted && !stop.load(Ordering::Relaxed) {}
        account.callback_end();
        account.block();
        due += PERIOD;
        clock::sleep_until(due);
    }
    Ok(())
}

//! `bench foreign flood`: a control loop and a middleware in one foreign program, all at one
//! priority, as threads of Fast DDS inherit it. The middleware gets 50 000 datagrams a second.
//!
//! The middleware is a stand-in in C: threads named `dds.udp.N` that take datagrams and work 20 us
//! on each. Every round measures all cases one after another, so that they see the same machine. A
//! window in which the machine stood still is measured again.

use super::adopted::Adopted;
use super::options::Options;
use super::program::{Program, Workshop};
use crate::load::{MS, Nanos};
use crate::testbench::probe;
use replenish_cli::lock;
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::table::{Table, percent_with};
use replenish_os::{CpuSet, SchedClass, clock, current_tid, set_affinity};
use std::net::UdpSocket;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Rounds of the control loop in a window, 2 ms each.
const ROUNDS: u32 = 750;
/// A window in which the machine stood still for longer is measured again: half of a response.
const STILL: Nanos = 200_000;
/// The middleware's budget in percent.
const BUDGET: f64 = 10.0;
/// A flood of this length ends by itself, so that a starved loop gets on.
const LONGEST: Nanos = 4_000 * MS;
/// Times that a window is measured again at most. The one with the shortest standstill counts.
const REPEATS: u32 = 10;

/// One case: whether there is a flood, and whether the middleware has a budget.
#[derive(Debug, Default)]
struct Case {
    flood: bool,
    adopted: bool,
    responses: Vec<i64>,
    /// CPU time of the middleware, and the time that passed.
    used: Nanos,
    elapsed: Nanos,
    sent: u64,
}

/// `bench foreign flood`.
pub(super) fn run(options: &Options) -> Outcome {
    let cpus = options.cpus()?;
    let _alone = lock::acquire()?;
    let workshop = Workshop::new()?;
    let control = workshop.c("control", include_str!("programs/control.c"))?;
    let mut command = Command::new(control);
    command.args(["2", "20"]);
    let mut program = Program::start(&mut command, cpus.measured, SchedClass::Fifo(50))?;
    let port: u16 = program.greeting.parse().map_err(Failure::refused)?;
    let case = |(flood, adopted)| Case {
        flood,
        adopted,
        ..Case::default()
    };
    let mut cases = [(false, false), (false, true), (true, true), (true, false)].map(case);
    let (mut repeated, mut worst) = (0, 0);
    for _ in 0..options.windows {
        for case in &mut cases {
            let mut measure = || measure(&workshop, &mut program, &cpus, port, case);
            let (mut more, mut stall) = measure()?;
            for _ in 0..REPEATS {
                if stall <= STILL {
                    break;
                }
                repeated += 1;
                let again = measure()?;
                if again.1 < stall {
                    (more, stall) = again;
                }
            }
            worst = worst.max(stall);
            case.responses.extend(more.responses);
            case.used += more.used;
            case.elapsed += more.elapsed;
            case.sent += more.sent;
        }
    }
    let alone = p99(&cases[0]);
    let mut table = Table::new(&[
        "flood",
        "budget",
        "sent/s",
        "median us",
        "p99 us",
        "ratio",
        "middleware's CPU",
    ]);
    let mut json = Vec::new();
    for case in &cases {
        let sorted = Sorted::new(case.responses.clone());
        let ratio = p99(case) as f64 / alone.max(1) as f64;
        let seconds = case.elapsed as f64 / 1e9;
        let share = case.used as f64 * 100.0 / case.elapsed.max(1) as f64;
        table.row([
            if case.flood { "yes" } else { "no" }.into(),
            if case.adopted { "10 ms/100 ms" } else { "none" }.into(),
            format!("{:.0}", case.sent as f64 / seconds),
            format!("{:.1}", us(sorted.median())),
            format!("{:.1}", us(p99(case))),
            format!("{ratio:.2}"),
            percent_with(share, 2),
        ]);
        json.push(serde_json::json!({
            "flood": case.flood, "budget": case.adopted, "median_ns": sorted.median(),
            "p99_ns": p99(case), "ratio": ratio, "middleware_percent": share,
            "over_budget_percent": case.adopted.then_some(share - BUDGET),
            "sent_per_s": case.sent as f64 / seconds, "samples": sorted.len(),
        }));
    }
    println!("{}", table.to_text());
    println!(
        "  {repeated} windows were measured again, because the machine stood still; in those that \
         count for {} us at most",
        worst / 1000
    );
    let json = serde_json::json!({ "cases": json, "repeated": repeated });
    options.write("bench-foreign-flood", &json)
}

fn p99(case: &Case) -> i64 {
    Sorted::new(case.responses.clone()).percentile(99)
}

/// One window, and the longest time that the machine stood still in it.
fn measure(
    workshop: &Workshop,
    program: &mut Program,
    cpus: &Cpus,
    port: u16,
    case: &Case,
) -> Result<(Case, Nanos), Failure> {
    let (cpu, budget) = (cpus.measured, "dds.*=10ms/100ms@30");
    let options = ["--thread", budget, "--background", "suspend"];
    let adopted = case
        .adopted
        .then(|| Adopted::start(workshop, &[program], cpu, &options));
    let adopted = adopted.transpose()?;
    let flood = case.flood.then(|| Flood::start(cpus.support, port));
    let flood = flood.transpose()?;
    // Its first burst is over: one budget that was saved up.
    clock::sleep_until(clock::monotonic() + 200 * MS);
    let (begin, before) = (clock::monotonic(), program.cpu("dds."));
    let sent = flood
        .as_ref()
        .map_or(0, |flood| flood.sent.load(Ordering::Relaxed));
    let probe = probe::start(cpu)?;
    let responses = program.ask(ROUNDS)?;
    let stall = probe.stop();
    let (end, after) = (clock::monotonic(), program.cpu("dds."));
    let all = flood
        .as_ref()
        .map_or(0, |flood| flood.sent.load(Ordering::Relaxed));
    drop(flood);
    adopted.map(Adopted::finish).transpose()?;
    let window = Case {
        responses,
        used: after.saturating_sub(before),
        elapsed: end.saturating_sub(begin),
        sent: all - sent,
        ..Case::default()
    };
    Ok((window, stall))
}

/// A thread that sends; it ends when this is dropped.
struct Flood {
    stop: Arc<AtomicBool>,
    sent: Arc<AtomicU64>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Flood {
    fn start(cpu: usize, port: u16) -> Result<Self, Failure> {
        let socket = UdpSocket::bind("127.0.0.1:0").map_err(Failure::refused)?;
        socket
            .connect(("127.0.0.1", port))
            .map_err(Failure::refused)?;
        let (stop, sent) = (Arc::<AtomicBool>::default(), Arc::<AtomicU64>::default());
        let (ended, counter) = (Arc::clone(&stop), Arc::clone(&sent));
        let thread = std::thread::spawn(move || {
            set_affinity(current_tid(), &CpuSet::one(cpu)).ok(); // it runs anywhere
            let begin = clock::monotonic();
            let mut due = begin;
            while !ended.load(Ordering::Relaxed) && due < begin + LONGEST {
                for _ in 0..50 {
                    if socket.send(&[7; 64]).is_ok() {
                        counter.fetch_add(1, Ordering::Relaxed);
                    }
                }
                due += MS;
                clock::sleep_until(due);
            }
        });
        Ok(Self {
            stop,
            sent,
            thread: Some(thread),
        })
    }
}

impl Drop for Flood {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().ok(); // it cannot panic
        }
    }
}

//! `bench enforcement --shares`: the long-run share of workers that always want the CPU, by the
//! kernel's clocks of their threads.
//!
//! ```text
//!   begin                begin + T              …          begin + n T
//!     │█B█ stopped         │█B█ stopped                    │
//!     └ clocks read                        clocks read ────┘ a little before: n B later
//! ```
//!
//! A worker that has used its budget is stopped, so that all of its CPU time is budget. Beside it
//! no thread of ours wants the CPU.

use super::schedule::WORKER_PRIORITY;
use crate::load::spec::{ENFORCER_PRIORITY, MAX_REPL};
use crate::load::{MS, Nanos};
use crate::testbench::summary::as_f64;
use replenish_cli::outcome::Failure;
use replenish_cli::report::table::{Table, signed_percent};
use replenish_cli::signals::Stop;
use replenish_os::clock::ThreadCpuClock;
use replenish_os::{Enforcer, EnforcerConfig, Policy, Thread, ThreadSpec, clock, spawn};
use sporadic::{Kind, Low, Params};
use std::fmt::Display;
use std::sync::{Arc, mpsc};

const US: Nanos = 1_000;

/// Budget, period and number of workers.
const CASES: [(Nanos, Nanos, usize); 6] = [
    (50 * US, 500 * US, 1),
    (100 * US, MS, 1),
    (800 * US, 3 * MS, 1),
    (2_500 * US, 11 * MS, 1),
    (23 * MS, 70 * MS, 1),
    (2_500 * US, 100 * MS, 32),
];

/// The share of one reservation. Names are a contract.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct Share {
    budget_us: f64,
    period_us: f64,
    workers: usize,
    periods: u64,
    /// Budget over period.
    due_percent: f64,
    /// CPU time over time: the mean of all workers.
    had_percent: f64,
    /// The largest deviation of a worker, in percent of what was due.
    worst_deviation_percent: f64,
    /// CPU time of the enforcer.
    enforcer_cpu_percent: f64,
}

/// Measures every case for `seconds`.
pub(super) fn measure(cpu: usize, seconds: u64, stop: &Stop) -> Result<Vec<Share>, Failure> {
    let mut shares = Vec::new();
    for (budget, period, workers) in CASES {
        if stop.is_triggered() {
            return Err(Failure::refused("interrupted"));
        }
        shares.push(measure_one(cpu, budget, period, workers, seconds, stop)?);
    }
    Ok(shares)
}

fn measure_one(
    cpu: usize,
    budget: Nanos,
    period: Nanos,
    workers: usize,
    seconds: u64,
    stop: &Stop,
) -> Result<Share, Failure> {
    let config = EnforcerConfig {
        priority: ENFORCER_PRIORITY,
        capacity: workers,
        ..EnforcerConfig::on_cpu(cpu)
    };
    let params = Params::new(WORKER_PRIORITY, Low::Suspend, budget, period, MAX_REPL);
    let params = params.map_err(|e| failed(&e))?;
    let enforcer = Enforcer::start(config).map_err(|e| failed(&e))?;
    let begin = clock::monotonic() + 200 * MS;
    let periods = (seconds * 1_000 * MS / period).max(1);
    // All of a period's budget has been used some time before its end.
    let read_at = begin + periods * period - period / 10;
    let end = begin + periods * period;
    let mut threads = Vec::new();
    for n in 0..workers {
        let hungry = start(cpu, n, params, &enforcer, begin, end, stop)?;
        threads.push(hungry);
    }
    let clocks: Vec<_> = threads
        .iter()
        .map(|t| ThreadCpuClock::of(t.tid()))
        .collect();
    let read = || -> Vec<Nanos> { clocks.iter().filter_map(ThreadCpuClock::read).collect() };
    clock::sleep_until(begin - 10 * MS);
    let (before, enforcer_before) = (read(), enforcer.stats().cpu);
    clock::sleep_until(read_at);
    let (after, enforcer_after) = (read(), enforcer.stats().cpu);
    for thread in threads {
        thread.join().map_err(|_| failed(&"a worker panicked"))?;
    }
    enforcer.stop();
    if after.len() != workers || before.len() != workers {
        return Err(failed(&"a worker ended before its time"));
    }
    let due = as_f64(periods * budget);
    let had: Vec<f64> = before
        .iter()
        .zip(&after)
        .map(|(before, after)| as_f64(after - before))
        .collect();
    let deviation = had.iter().map(|had| (had - due) * 100.0 / due);
    let worst = deviation.fold(0.0, |w: f64, d| if d.abs() > w.abs() { d } else { w });
    let mean = had.iter().sum::<f64>() / had.len().max(1) as f64;
    let span = as_f64(periods * period);
    Ok(Share {
        budget_us: as_f64(budget) / 1e3,
        period_us: as_f64(period) / 1e3,
        workers,
        periods,
        due_percent: as_f64(budget) * 100.0 / as_f64(period),
        had_percent: mean * 100.0 / span,
        worst_deviation_percent: worst,
        enforcer_cpu_percent: as_f64(enforcer_after - enforcer_before) * 100.0 / span,
    })
}

/// A worker that wants the CPU from `begin` to `end`.
fn start(
    cpu: usize,
    n: usize,
    params: Params,
    enforcer: &Arc<Enforcer>,
    begin: Nanos,
    end: Nanos,
    stop: &Stop,
) -> Result<Thread<()>, Failure> {
    let policy = Policy::fifo(WORKER_PRIORITY).map_err(|e| failed(&e))?;
    let spec = ThreadSpec::new(format!("hungry/{n}"))
        .policy(policy)
        .cpu(cpu);
    let (enforcer, stop) = (Arc::clone(enforcer), stop.clone());
    let (tell, enrolled) = mpsc::channel();
    let thread = spawn(spec, move || {
        let mut account = match enforcer.enroll(&params, Kind::Corrected) {
            Ok(account) => account,
            Err(e) => return drop(tell.send(Err(e.to_string()))),
        };
        tell.send(Ok(())).ok(); // the bench has gone if nobody listens
        clock::sleep_until(begin);
        account.activate(begin);
        if account.callback_begin().is_ok() {
            while clock::monotonic() < end && !stop.is_triggered() {
                for _ in 0..100 {
                    std::hint::spin_loop();
                }
            }
            account.callback_end();
        }
        account.block();
    });
    let thread = thread.map_err(|e| failed(&e))?;
    enrolled
        .recv()
        .map_err(|e| failed(&e))?
        .map_err(|e| failed(&e))?;
    Ok(thread)
}

fn failed(e: &dyn Display) -> Failure {
    Failure::refused(format!("hungry workers: {e}"))
}

pub(super) fn table(shares: &[Share]) -> Table {
    let mut table = Table::new(&[
        "budget ms",
        "period ms",
        "workers",
        "periods",
        "due",
        "had",
        "worst deviation",
        "enforcer CPU",
    ]);
    for s in shares {
        table.row([
            format!("{}", s.budget_us / 1e3),
            format!("{}", s.period_us / 1e3),
            s.workers.to_string(),
            s.periods.to_string(),
            format!("{:.4} %", s.due_percent),
            format!("{:.4} %", s.had_percent),
            signed_percent(s.worst_deviation_percent),
            format!("{:.2} %", s.enforcer_cpu_percent),
        ]);
    }
    table
}

//! Workers that always want more than their budget, enrolled with an enforcer directly.

use super::schedule::{Schedule, WORKER_PRIORITY, Window};
use crate::load::spec::{BACKGROUND, ENFORCER_PRIORITY, MAX_REPL};
use crate::load::{MS, Nanos};
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::{
    Account, Enforcer, EnforcerConfig, Meter, Policy, Thread, ThreadSpec, Usage, clock, spawn,
};
use sporadic::{Kind, Low, Params};
use std::fmt::Display;
use std::sync::{Arc, mpsc};

/// An enforcer and its workers.
pub(super) struct Spinners {
    enforcer: Arc<Enforcer>,
    threads: Vec<Thread<()>>,
    meters: Vec<Meter>,
}

/// Measurements of one run.
#[derive(Debug, Default)]
pub(super) struct Measured {
    /// CPU time beyond the budget per exhaustion, in nanoseconds.
    pub overruns: Vec<i64>,
    /// Overruns during which the machine stood still.
    pub stalls: Vec<i64>,
    /// CPU time of the enforcer inside the windows.
    pub enforcer_cpu: Nanos,
    /// The time that the windows took.
    pub time: Nanos,
    /// Per worker: CPU time at the high priority inside the undisturbed windows.
    pub high: Vec<Nanos>,
    /// The time that the undisturbed windows took.
    pub undisturbed_time: Nanos,
    /// Windows in which the machine stood still, or another thread had the CPU.
    pub disturbed: u64,
    /// Wake-ups of the enforcer.
    pub wakes: u64,
}

/// The state of all at one moment.
struct Snapshot {
    high: Vec<Nanos>,
    all: Nanos,
    enforcer: Nanos,
    wakes: u64,
}

/// Time in ns that none of our threads had: a window with more of it is no measure of shares.
const DISTURBED: Nanos = MS;

impl Spinners {
    /// Starts an enforcer and `count` workers on `cpu`, each with `budget` per `period`.
    pub(super) fn start(
        cpu: usize,
        count: usize,
        budget: Nanos,
        period: Nanos,
        schedule: Schedule,
        stop: &Stop,
    ) -> Result<Self, Failure> {
        let params = Params::new(
            WORKER_PRIORITY,
            Low::Background(BACKGROUND),
            budget,
            period,
            MAX_REPL,
        )
        .map_err(|e| failed(&e))?;
        let config = EnforcerConfig {
            priority: ENFORCER_PRIORITY,
            capacity: count,
            ..EnforcerConfig::on_cpu(cpu)
        };
        let enforcer = Enforcer::start(config).map_err(|e| failed(&e))?;
        let mut spinners = Self {
            enforcer,
            threads: Vec::new(),
            meters: Vec::new(),
        };
        for n in 0..count {
            let policy = Policy::fifo(WORKER_PRIORITY).map_err(|e| failed(&e))?;
            let spec = ThreadSpec::new(format!("spinner/{n}"))
                .policy(policy)
                .cpu(cpu);
            let (enforcer, stop, params) = (Arc::clone(&spinners.enforcer), stop.clone(), params);
            let (tx, enrolled) = mpsc::channel();
            let body = move || match enforcer.enroll(&params, Kind::Corrected) {
                Ok(account) => {
                    tx.send(Ok(account.meter())).ok(); // the bench has gone if nobody listens
                    spin(account, schedule, &stop);
                }
                Err(e) => drop(tx.send(Err(e.to_string()))),
            };
            spinners
                .threads
                .push(spawn(spec, body).map_err(|e| failed(&e))?);
            let meter = enrolled
                .recv()
                .map_err(|e| failed(&e))?
                .map_err(|e| failed(&e))?;
            spinners.meters.push(meter);
        }
        Ok(spinners)
    }

    /// Takes snapshots at the edges of the windows until all are over; runs on another CPU.
    pub(super) fn measure(
        &self,
        schedule: Schedule,
        stop: &Stop,
        done: &mut dyn FnMut(),
    ) -> Measured {
        let mut m = Measured {
            high: vec![0; self.meters.len()],
            ..Measured::default()
        };
        // CPU time of a worker on its way into the wait is charged to the next window.
        let mut at_last_end = None;
        for Window { start, end } in schedule.windows() {
            if stop.is_triggered() {
                break;
            }
            clock::sleep_until(start);
            let from = self.snapshot();
            clock::sleep_until(end);
            let to = self.snapshot();
            let charged_from = at_last_end.replace(to.high.clone()).unwrap_or(from.high);
            let used = to.all.saturating_sub(from.all);
            m.enforcer_cpu += to.enforcer.saturating_sub(from.enforcer);
            m.wakes += to.wakes.saturating_sub(from.wakes);
            m.time += end - start;
            // The workers always want the CPU: other threads had the rest of the time.
            if used.saturating_add(DISTURBED) < end - start {
                m.disturbed += 1;
            } else {
                m.undisturbed_time += end - start;
                for ((sum, from), to) in m.high.iter_mut().zip(charged_from).zip(to.high) {
                    *sum += to.saturating_sub(from);
                }
            }
            done();
        }
        m
    }

    fn snapshot(&self) -> Snapshot {
        let usages: Vec<Usage> = self.meters.iter().map(Meter::usage).collect();
        let stats = self.enforcer.stats();
        Snapshot {
            all: usages.iter().map(|u| u.cpu_high + u.cpu_low).sum::<Nanos>() + stats.cpu,
            high: usages.iter().map(|u| u.cpu_high).collect(),
            enforcer: stats.cpu,
            wakes: stats.wakes,
        }
    }

    /// Ends everything; the overruns of all workers.
    pub(super) fn finish(self, mut measured: Measured) -> Result<Measured, Failure> {
        for thread in self.threads {
            thread.join().map_err(|_| failed(&"a worker panicked"))?;
        }
        for meter in &self.meters {
            let samples = meter.overrun_samples();
            measured.overruns.extend(samples.overruns);
            measured
                .stalls
                .extend(samples.stalls.iter().map(|s| s.overrun));
        }
        self.enforcer.stop();
        Ok(measured)
    }
}

fn failed(e: &dyn Display) -> Failure {
    Failure::refused(format!("budgeted workers: {e}"))
}

/// A worker: wants the CPU for the whole of every window. It takes no lock meanwhile: lowered with
/// one in its hands, it would make the others block, and their budgets would come back in pieces.
fn spin(mut account: Account, schedule: Schedule, stop: &Stop) {
    for Window { start, end } in schedule.windows() {
        clock::sleep_until(start);
        account.activate(start);
        if account.callback_begin().is_err() {
            return;
        }
        while clock::monotonic() < end && !stop.is_triggered() {
            for _ in 0..100 {
                std::hint::spin_loop();
            }
        }
        account.callback_end();
        account.block();
    }
}

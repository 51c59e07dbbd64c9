//! The engine's state of a thread, a lock and a CPU.

use super::cbs::Cbs;
use super::phase::{Phase, Rank};
use crate::{
    Enforcement, LockId, Nanos, Platform, Policy, Random, Releases, Thread, ThreadOutcome,
};
use sporadic::{Level, Readings, Reservation, Server, Tuning};
use std::collections::VecDeque;

/// The largest `max_repl` of a simulated server.
pub(crate) const CAPACITY: usize = 128;

type Budget = Reservation<Server<CAPACITY>>;

/// The last record of a budget.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Noted {
    pub(super) left: Nanos,
    /// The thread's CPU clock then.
    pub(super) clock: Nanos,
    /// Whether what it consumed from then on was charged.
    pub(super) charged: bool,
}

pub(super) struct State<'a> {
    pub(super) policy: &'a Policy,
    pub(super) releases: &'a Releases,
    pub(super) random: Random,
    pub(super) phase: Phase,
    /// Releases handled so far.
    pub(super) release_index: usize,
    /// Arrivals of the jobs that wait.
    pub(super) jobs: VecDeque<Nanos>,
    /// Arrival of the current job.
    pub(super) arrival: Nanos,
    /// Whether the current job has had the CPU.
    pub(super) started: bool,
    /// The next step of the current job.
    pub(super) step: usize,
    /// CPU time to consume before the next step.
    pub(super) left: Nanos,
    /// The thread's CPU clock.
    pub(super) cpu_clock: Nanos,
    pub(super) budget: Option<Box<Budget>>,
    /// The trace's last record of its budget.
    pub(super) noted: Noted,
    pub(super) cbs: Option<Cbs>,
    /// Urgency with inheritance; `None`: must not run.
    pub(super) rank: Option<Rank>,
    /// Whether it is in the ready list.
    pub(super) queued: bool,
    /// The CPU it runs on.
    pub(super) on: Option<usize>,
    /// The time at which it woke, which its enforcer learns when it runs.
    pub(super) woken: Option<Nanos>,
    /// The check that is set.
    pub(super) check_at: Option<Nanos>,
    /// Locks it holds.
    pub(super) held: Vec<LockId>,
    pub(super) out: ThreadOutcome,
}

impl<'a> State<'a> {
    pub(super) fn new(
        thread: &'a Thread,
        platform: &Platform,
        seed: u64,
        id: usize,
    ) -> Result<Self, String> {
        let budget = match thread.policy.params() {
            Some(params) => {
                let tuning = match platform.enforcement {
                    Enforcement::Kernel => Tuning {
                        slack: 0,
                        min_rearm: 0,
                        max_backoff: 0,
                    },
                    Enforcement::Timer { tuning, .. } => tuning,
                };
                let server = Server::<CAPACITY>::new(thread.server, *params, 0)
                    .map_err(|error| error.to_string())?
                    .with_min_chunk(tuning.slack);
                let tuning = tuning.for_budget(params.budget());
                Some(Box::new(Reservation::new(server, tuning, 0, 0)))
            }
            None => None,
        };
        let cbs = match thread.policy {
            Policy::Deadline {
                runtime,
                deadline,
                period,
                ..
            } => Some(Cbs::new(runtime, deadline, period)),
            _ => None,
        };
        Ok(Self {
            policy: &thread.policy,
            releases: &thread.releases,
            random: Random::stream(seed, id),
            phase: Phase::Idle,
            release_index: 0,
            jobs: VecDeque::new(),
            arrival: 0,
            started: false,
            step: 0,
            left: 0,
            cpu_clock: 0,
            budget,
            noted: Noted::default(),
            cbs,
            rank: None,
            queued: false,
            on: None,
            woken: None,
            check_at: None,
            held: Vec::new(),
            out: ThreadOutcome::default(),
        })
    }

    /// Urgency without inheritance; `None`: must not run.
    pub(super) fn base_rank(&self) -> Option<Rank> {
        match self.policy {
            Policy::Other => Some(0),
            Policy::Fifo { priority } | Policy::RoundRobin { priority } => {
                Some(u64::from(*priority))
            }
            Policy::Sporadic(params) | Policy::KernelSporadic(params) => {
                let level = self.budget.as_ref().map_or(Level::High, |b| b.level());
                match (level, params.low()) {
                    (Level::High, _) => Some(u64::from(params.priority())),
                    (Level::Low, sporadic::Low::Background(low)) => Some(u64::from(low)),
                    (Level::Low, sporadic::Low::Suspend) => None,
                }
            }
            Policy::Deadline { .. } => self.cbs.as_ref().and_then(Cbs::rank),
        }
    }

    /// Charges the thread for a run of `span` ns.
    pub(super) fn consume(&mut self, span: Nanos) {
        self.left -= span;
        self.cpu_clock += span;
        if let Some(cbs) = &mut self.cbs {
            cbs.consume(span);
        }
    }

    /// Closes the books.
    pub(super) fn finish(&mut self, now: Nanos) -> ThreadOutcome {
        let mut out = core::mem::take(&mut self.out);
        if let Some(budget) = &mut self.budget {
            budget.observe(now, self.cpu_clock, Readings::Exact(&[]));
            let counters = budget.counters();
            out.cpu_high = counters.cpu_high;
            out.cpu_low = counters.cpu_low;
            out.exhaustions = counters.exhaustions;
            out.replenishments = counters.replenishments;
        } else {
            out.cpu_high = self.cpu_clock;
        }
        out
    }
}

#[derive(Debug, Clone, Default)]
pub(super) struct Lock {
    pub(super) owner: Option<usize>,
    /// In order of arrival.
    pub(super) waiters: Vec<usize>,
}

#[derive(Debug, Clone, Default)]
pub(super) struct Cpu {
    pub(super) running: Option<usize>,
    /// The thread that ran last.
    pub(super) last: Option<usize>,
    /// Until then it handles interrupts.
    pub(super) stalled_until: Nanos,
    pub(super) idle: Nanos,
    pub(super) overhead: Nanos,
}

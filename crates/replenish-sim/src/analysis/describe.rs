//! From a system that can be simulated to what the analysis is told of it.

use super::{Costs, Demand, Section, Task};
use crate::{Enforcement, Nanos, Platform, Policy, Releases, Step, System, Thread, ThreadId};

impl Costs {
    /// The worst of what this platform does, without the CPU time of the enforcer's checks.
    pub fn of(platform: &Platform) -> Self {
        let mut costs = Self {
            context_switch: platform.context_switch,
            job: platform.job,
            release_interrupt: platform.release_interrupt,
            tick: platform.tick.unwrap_or(0),
            ..Self::default()
        };
        if let Enforcement::Timer {
            tuning, latency, ..
        } = &platform.enforcement
        {
            costs.latency = latency.max();
            costs.put_off = tuning.max_backoff + tuning.min_rearm;
            costs.slack = tuning.slack;
        }
        costs
    }
}

/// The threads that are pinned to `cpu`, described for [`bounds`](super::bounds).
///
/// Their bodies and releases say what they do. `None` if the analysis does not cover one of them:
/// `SCHED_DEADLINE`, releases by other threads ([`Step::Send`] to it), bursts, traces, blocking
/// with a lock held, the POSIX server, or blocking that is not seen, in a reservation. Threads of
/// [`Policy::Other`] are left out; they may share no lock.
pub fn describe(system: &System, cpu: usize) -> Option<Vec<(ThreadId, Task)>> {
    let pinned = system.threads.iter().enumerate();
    pinned
        .filter(|(_, thread)| thread.cpu == Some(cpu) && thread.policy != Policy::Other)
        .map(|(id, thread)| Some((id, describe_thread(system, thread)?)))
        .collect()
}

fn describe_thread(system: &System, thread: &Thread) -> Option<Task> {
    let (period, jitter) = match thread.releases {
        Releases::Periodic { period, jitter, .. } => (period, jitter),
        Releases::Sporadic { ref gap, .. } => (gap.min().max(1), 0),
        Releases::Never | Releases::Bursty { .. } | Releases::At(_) => return None,
    };
    let mut demand = Demand {
        jitter,
        ..Demand::new(0, period)
    };
    let mut held: Vec<(usize, Nanos)> = Vec::new();
    let mut sections = Vec::new();
    for step in &thread.body {
        match step {
            Step::Run(span) => {
                demand.cost += span.max();
                for (_, length) in &mut held {
                    *length += span.max();
                }
            }
            Step::Block(_) if !held.is_empty() => return None,
            Step::Block(span) => {
                demand.suspensions += 1;
                demand.suspended += span.max();
            }
            Step::Lock(lock) => held.push((*lock, 0)),
            Step::Unlock(lock) => {
                let at = held.iter().position(|(other, _)| other == lock)?;
                let (lock, length) = held.remove(at);
                sections.push(Section { lock, length });
            }
            Step::Send(_) => {}
        }
    }
    let mut task = match thread.policy {
        Policy::Fifo { priority } | Policy::RoundRobin { priority } => Task::fifo(priority, demand),
        Policy::Sporadic(params) | Policy::KernelSporadic(params) => {
            let unseen = demand.suspensions > 0 && !system.platform.blocking_seen;
            if thread.server != sporadic::Kind::Corrected || unseen {
                return None;
            }
            Task::reserved(params, Some(demand))
        }
        Policy::Other | Policy::Deadline { .. } => return None,
    };
    task.sections = sections;
    Some(task)
}

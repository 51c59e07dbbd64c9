//! Makes the input of the analysis from a system that can be simulated.

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
            costs.tuning = *tuning;
        }
        costs
    }
}

/// The threads that are pinned to `cpu`, described for [`bounds`](super::bounds).
///
/// Their bodies and releases say what they do. `None` if the analysis does not cover one of them:
/// `SCHED_DEADLINE`, releases by other threads ([`Step::Send`] to it), bursts, traces, blocking
/// with a lock held, the POSIX server, or blocking that is not seen, in a reservation. Threads of
/// [`Policy::Other`] that take no lock are left out.
pub fn describe(system: &System, cpu: usize) -> Option<Vec<(ThreadId, Task)>> {
    let pinned = system.threads.iter().enumerate();
    let takes_locks = |thread: &Thread| thread.body.iter().any(|s| matches!(s, Step::Lock(_)));
    pinned
        .filter(|(_, thread)| thread.cpu == Some(cpu))
        .filter(|(_, thread)| thread.policy != Policy::Other || takes_locks(thread))
        .map(|(id, thread)| Some((id, describe_thread(system, thread)?)))
        .collect()
}

fn describe_thread(system: &System, thread: &Thread) -> Option<Task> {
    if thread.policy == Policy::Other {
        let (_, sections) = job(thread, Demand::new(0, 1))?;
        return Some(Task::background(sections));
    }
    let (period, jitter) = match thread.releases {
        Releases::Periodic { period, jitter, .. } => (period, jitter),
        Releases::Sporadic { ref gap, .. } => (gap.min().max(1), 0),
        Releases::Never | Releases::Bursty { .. } | Releases::At(_) => return None,
    };
    let released = Demand {
        jitter,
        ..Demand::new(0, period)
    };
    let (demand, sections) = job(thread, released)?;
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

/// The demand of one job: CPU time, waits, locks.
fn job(thread: &Thread, mut demand: Demand) -> Option<(Demand, Vec<Section>)> {
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
    Some((demand, sections))
}

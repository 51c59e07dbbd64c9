//! End-to-end bounds of chains: a message goes from worker to worker.

use super::{Costs, Task, bounds};
use crate::Nanos;

/// One stage of a chain, for [`end_to_end`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// Bound of its response from its release (a bound from the arrival less its jitter), in ns.
    pub response: Nanos,
    /// If it is not released by its input but samples the latest one: the distance of its
    /// releases, in ns.
    pub sampling: Option<Nanos>,
}

/// From the arrival of the first input to the end of the last stage that has made use of it, in ns.
///
/// - A stage released by its input: its response (TC94).
/// - A stage that samples: an input can just miss a release, so a whole period more (DZNP07).
pub fn end_to_end(stages: &[Stage]) -> Nanos {
    let of = |stage: &Stage| stage.sampling.unwrap_or(0).saturating_add(stage.response);
    stages.iter().map(of).fold(0, Nanos::saturating_add)
}

/// A task of a chain: its CPU, and its place among the tasks of that CPU.
pub type Place = (usize, usize);

/// Bounds of a chain by events over several CPUs: for each stage, from the arrival of the first
/// input to the end of the stage, in ns. `None` if a stage has no bound, or a place is none.
///
/// Holistic analysis (TC94): a stage is released by the end of the stage before, so it arrives with
/// the first input and has the bound of the stage before as its jitter; that changes how the stages
/// interfere, also with each other, so it is repeated until nothing changes. Each stage but the
/// first gets the period of the first; its own period and jitter are ignored.
pub fn by_events(cpus: &[Vec<Task>], chain: &[Place], costs: &Costs) -> Option<Vec<Nanos>> {
    let mut cpus = cpus.to_vec();
    let (&first, others) = chain.split_first()?;
    let period = demand_at(&mut cpus, first)?.period;
    for &place in others {
        let demand = demand_at(&mut cpus, place)?;
        demand.period = period;
        demand.jitter = 0;
    }
    loop {
        let found: Vec<_> = cpus.iter().map(|tasks| bounds(tasks, costs)).collect();
        let ends = chain.iter().map(|&(cpu, task)| found[cpu][task].response);
        let ends: Vec<Nanos> = ends.collect::<Option<_>>()?;
        let mut changed = false;
        for (&place, &before) in others.iter().zip(&ends) {
            let demand = demand_at(&mut cpus, place)?;
            changed |= demand.jitter < before;
            // Never back, so that it comes to an end: at the latest where a bound is lost.
            demand.jitter = demand.jitter.max(before);
        }
        if !changed {
            return Some(ends);
        }
    }
}

fn demand_at(cpus: &mut [Vec<Task>], (cpu, task): Place) -> Option<&mut super::Demand> {
    cpus.get_mut(cpu)?.get_mut(task)?.demand.as_mut()
}

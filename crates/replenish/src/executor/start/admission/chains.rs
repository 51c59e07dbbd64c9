//! Chains that are guaranteed: each one's bound under the plan, or why it does not hold.

use crate::error::Error;
use crate::executor::run::state::WorkerSpec;
use crate::platform::chain::{Requested, RequestedChain};
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::time::Duration;
use replenish_plan::{Guarantee, Plan};

/// A stage's worker, and whether the stage samples: nothing releases it but the clock.
type Stage<'a> = (&'a WorkerSpec, bool);

/// Gives each guaranteed chain its bound; before the plan is written into the requests.
pub(super) fn admit(
    plan: Option<&Plan>,
    workers: &[WorkerSpec],
    chains: &mut Requested,
) -> Result<(), Error> {
    for chain in chains.0.iter_mut().filter(|chain| chain.is_promised) {
        let found: Option<Vec<Stage<'_>>> = chain
            .stages
            .iter()
            .map(|stage| find(stage, workers))
            .collect();
        // A stage that does not exist is refused where stages become handles.
        if let Some(stages) = found {
            chain.bound = Some(bound(chain, &stages, plan)?);
        }
    }
    Ok(())
}

fn find<'a>(stage: &str, workers: &'a [WorkerSpec]) -> Option<Stage<'a>> {
    workers.iter().find_map(|worker| {
        let entry = worker.entries.iter().find(|e| e.shared.id == stage);
        if let Some(entry) = entry {
            return Some((worker, entry.shared.input.is_none()));
        }
        let samples = || worker.entries.iter().all(|e| e.shared.input.is_none());
        (*worker.request.name == *stage).then(|| (worker, samples()))
    })
}

/// The sum of the responses, and a period more for a stage that samples: an input can just miss a
/// release (DZNP07). A stage that is released by the one before it arrives as late as that may end,
/// and no more often than its own guarantee has room for (TC94).
fn bound(chain: &RequestedChain, stages: &[Stage<'_>], plan: Option<&Plan>) -> Result<u64, Error> {
    let limit = chain.limit.unwrap_or(u64::MAX);
    let refused = |why: String| Error::NotAdmitted {
        reason: format!("chain {:?} does not hold: {why}", chain.name),
    };
    let (mut sum, mut gap) = (0_u64, 0);
    let (mut slowest, mut longest) = (String::new(), 0);
    for (place, (worker, samples)) in stages.iter().enumerate() {
        let name = &*worker.request.name;
        let guarantee = worker.request.wants().filter(Guarantee::is_rate);
        let planned = plan.and_then(|plan| plan.workers.iter().find(|w| *w.name == *name));
        let response = planned.and_then(|planned| planned.worst_response);
        let Some((guarantee, response)) = guarantee.zip(response) else {
            return Err(refused(format!(
                "nothing is certain for worker {name:?}; a guarantee with a rate and an execution \
                 time, Guarantee::at(…).taking(…), would do for it"
            )));
        };
        let period = guarantee.period();
        if place == 0 || *samples {
            gap = period;
        } else if period > gap {
            return Err(refused(format!(
                "the stages before worker {name:?} release it up to every {:?}, and its guarantee \
                 has room for one callback every {:?}",
                Duration::from_nanos(gap),
                Duration::from_nanos(period)
            )));
        }
        let wait = if place > 0 && *samples { period } else { 0 };
        let part = response.saturating_add(wait);
        sum = sum.saturating_add(part);
        if part > longest {
            (slowest, longest) = (name.into(), part);
        }
    }
    if sum > limit {
        let [sum, limit] = [sum, limit].map(Duration::from_nanos);
        return Err(refused(format!(
            "it could take up to {sum:?} where {limit:?} are allowed, most of it in worker \
             {slowest:?}; a limit of {sum:?} would fit"
        )));
    }
    Ok(sum)
}

//! Chains of workers: how late their stages are released, and how long the whole takes.

use super::deployment::{Chain, Deployment};
use crate::span::Rounded;
use crate::{Nanos, Plan, PlannedChain, Refusal, Requirement};
use replenish_sim::Releases;
use replenish_sim::analysis::chain::{Stage, end_to_end};

impl Deployment {
    /// The largest delay against a strict pattern with which others release each worker. The stages
    /// before it take what `plan` says: their responses, and the jitter of the first that is
    /// released by itself (TC94). 0 for workers with releases of their own.
    pub(super) fn lateness(&self, plan: &Plan) -> Vec<Nanos> {
        let mut late = vec![0; self.workers.len()];
        for chain in &self.chains {
            let mut sum: Nanos = 0;
            for &worker in &chain.workers {
                if self.is_led(worker) {
                    if let Some(late) = late.get_mut(worker) {
                        *late = sum.max(*late);
                    }
                } else {
                    sum = match self.workers.get(worker).map(|w| &w.load.releases) {
                        Some(Some(Releases::Periodic { jitter, .. })) => *jitter,
                        _ => 0,
                    };
                }
                let response = plan.workers.get(worker).and_then(|w| w.worst_response);
                sum = sum.saturating_add(response.unwrap_or(0));
            }
        }
        late
    }

    /// Whether a worker is released by the stage before it alone.
    pub(super) fn is_led(&self, worker: usize) -> bool {
        let load = self.workers.get(worker).map(|w| &w.load.releases);
        matches!(load, Some(Some(Releases::Never)))
    }

    /// Whether the worker at this place in [`workers`](Self::workers) is released by the clock: as
    /// a later stage of a chain it takes the latest input then.
    #[must_use]
    pub fn is_periodic(&self, worker: usize) -> bool {
        let load = self.workers.get(worker).map(|w| &w.load.releases);
        matches!(load, Some(Some(Releases::Periodic { .. })))
    }

    /// The bounds of all chains under `plan`.
    pub(super) fn chains(&self, plan: &Plan) -> Vec<PlannedChain> {
        let stages = |chain: &Chain| {
            let stage = |(place, &worker): (usize, &usize)| {
                let planned = plan.workers.get(worker)?;
                // A budget alone does not say how long a callback takes.
                let rate = match &self.workers.get(worker)?.scheduling {
                    Some(Requirement::Guarantee(guarantee)) => guarantee.is_rate(),
                    _ => true,
                };
                let sampling = match &self.workers.get(worker)?.load.releases {
                    _ if place == 0 => None,
                    Some(Releases::Periodic { period, .. }) => Some(*period),
                    Some(Releases::Sporadic { gap, .. }) => Some(gap.max()),
                    Some(Releases::Never) => None,
                    _ => return None,
                };
                // The jitter is in the response already, if it is not excused.
                Some(Stage {
                    response: planned.worst_response.filter(|_| rate)?,
                    sampling,
                })
            };
            let all: Option<Vec<Stage>> = chain.workers.iter().enumerate().map(stage).collect();
            all
        };
        let bound = |chain: &Chain| PlannedChain {
            name: chain.name.clone(),
            worst: stages(chain).map(|stages| end_to_end(&stages)),
            deadline: chain.deadline,
        };
        self.chains.iter().map(bound).collect()
    }

    /// The first chain that takes too long, in a sentence.
    pub(super) fn late_chain(&self, plan: &Plan) -> Option<Refusal> {
        let late = |chain: &&PlannedChain| {
            let bound = chain.worst.unwrap_or(Nanos::MAX);
            chain.deadline.is_some_and(|deadline| bound > deadline)
        };
        let at = plan.chains.iter().position(|chain| late(&chain))?;
        let (chain, described) = (plan.chains.get(at)?, self.chains.get(at)?);
        let deadline = Rounded(chain.deadline.unwrap_or(0));
        let slowest = described
            .workers
            .iter()
            .filter_map(|w| plan.workers.get(*w))
            .max_by_key(|w| w.worst_response.unwrap_or(Nanos::MAX));
        let slowest = slowest.map_or_else(String::new, |w| w.name.clone());
        let sentence = match chain.worst {
            Some(worst) => format!(
                "chain {:?} does not hold: it could take up to {} where its deadline allows {deadline}, most of it in worker {slowest:?}; a deadline of {} would fit",
                chain.name,
                Rounded(worst),
                Rounded(worst)
            ),
            None => format!(
                "chain {:?} does not hold: nothing is certain for worker {slowest:?}, whose callbacks' time is not stated, where the deadline allows {deadline}; a guarantee with a rate and an execution time would do for it",
                chain.name
            ),
        };
        Some(Refusal {
            worker: None,
            cpu: None,
            sentence,
            alternatives: Vec::new(),
            attempt: Some(Box::new(plan.clone())),
        })
    }
}

//! End-to-end bounds of chains: a message goes from worker to worker.

use crate::Nanos;

/// One stage of a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// Bound of its response, from the arrival of its input, in ns.
    pub response: Nanos,
    /// If it is not released by its input but samples the latest one: the distance of its
    /// releases, in ns.
    pub sampling: Option<Nanos>,
}

/// From the arrival of the first input to the end of the last stage that has made use of it, in ns.
///
/// - A stage released by its input: its response (TC94). That response must have been computed
///   with the jitter the stages before cause, see [`event_jitter`].
/// - A stage that samples: an input can just miss a release, so a whole period more (DZNP07).
pub fn end_to_end(stages: &[Stage]) -> Nanos {
    let of = |stage: &Stage| stage.sampling.unwrap_or(0).saturating_add(stage.response);
    stages.iter().map(of).fold(0, Nanos::saturating_add)
}

/// The release jitter of a stage that is released by the end of the stage before: the largest
/// less the smallest response, on top of the jitter that one has itself (TC94).
///
/// `response` counts from the arrival, so it contains that jitter already.
pub fn event_jitter(response: Nanos, best_response: Nanos) -> Nanos {
    response.saturating_sub(best_response)
}

/// For how long the output of a chain can be older than its next update: the age of data with
/// sampling stages, `end_to_end` and one more period of the source, in ns (DZNP07).
pub fn data_age(stages: &[Stage], source_period: Nanos) -> Nanos {
    end_to_end(stages).saturating_add(source_period)
}

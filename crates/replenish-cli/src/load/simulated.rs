//! What the simulator says a window gives: the same load on the same budget servers, in virtual
//! time. Of the machine it knows only what a message and an answer cost and how late they come
//! ([`Costs`]), as measured in the same run; nothing is fitted to the number of answers.

use super::Nanos;
use super::grid::Grid;
use super::spec::{High, Spec};
use crate::outcome::Failure;
use replenish_sim::Platform;
use replenish_sim::paper::{Counts, Point};

/// What this machine adds to the work that callbacks are asked to do, in ns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Costs {
    /// CPU time of dispatcher and enforcer, per message.
    pub dispatch: Nanos,
    /// CPU time of the high worker for receiving, decoding and answering, per callback.
    pub high: Nanos,
    /// The same on the low worker.
    pub low: Nanos,
    /// From the time that a message is sent to its callback, at best.
    pub arrival: Nanos,
    /// How late a sleeping callback wakes, at best.
    pub wake_up: Nanos,
}

/// Answers of one window: what the median of the runs gives, and the least and the most.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Answers {
    /// The median.
    pub median: u64,
    /// The least.
    pub min: u64,
    /// The most.
    pub max: u64,
}

impl Answers {
    fn of(mut runs: Vec<u64>) -> Self {
        runs.sort_unstable();
        Self {
            median: runs.get(runs.len() / 2).copied().unwrap_or(0),
            min: runs.first().copied().unwrap_or(0),
            max: runs.last().copied().unwrap_or(0),
        }
    }

    /// How far a measured number is from all runs.
    pub(crate) fn distance(&self, measured: u64) -> u64 {
        measured.abs_diff(measured.clamp(self.min, self.max))
    }
}

/// Answers to both topics in one window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Prediction {
    /// The topic with the budget.
    pub high: Answers,
    /// The other one.
    pub low: Answers,
}

/// An answer's cost varies by tens of microseconds from time to time: caches, interrupts, the
/// hypervisor. So the window is simulated with this much more per answer, too.
const MORE: [Nanos; 3] = [0, 20_000, 40_000];
/// A message takes up to twice the least time to arrive, drawn anew with each of these seeds.
const SEEDS: core::ops::Range<u64> = 0..5;

/// Simulates one window of the load `spec` on `grid`.
///
/// # Errors
/// A value of the load that the simulator's budget server does not take, by name.
pub(crate) fn per_window(spec: &Spec, grid: &Grid, costs: &Costs) -> Result<Prediction, Failure> {
    let cases = MORE.iter().flat_map(|more| SEEDS.map(|seed| (*more, seed)));
    let run = |(more, seed)| one_run(spec, grid, costs, more, seed);
    let runs: Vec<Counts> = cases.map(run).collect::<Result<_, _>>()?;
    Ok(Prediction {
        high: Answers::of(runs.iter().map(|c| c.high_answers).collect()),
        low: Answers::of(runs.iter().map(|c| c.low_answers).collect()),
    })
}

fn one_run(
    spec: &Spec,
    grid: &Grid,
    costs: &Costs,
    more: Nanos,
    seed: u64,
) -> Result<Counts, Failure> {
    let reservation = match spec.high {
        High::Sporadic {
            budget,
            period,
            background,
        } => Some((budget, period, background)),
        High::Fifo => None,
    };
    let answer = |work: Nanos, cost: Nanos| spec.net(work).saturating_add(cost);
    let point = Point {
        reservation,
        dispatch: costs.dispatch,
        high: answer(spec.burst, costs.high.saturating_add(more)),
        low: answer(spec.low_burn(), costs.low.saturating_add(more)),
        low_sleep: spec.low_sleep().saturating_add(costs.wake_up),
        interval: spec.interval,
        arrival: costs.arrival,
        jitter: costs.arrival,
        window: grid.window,
        platform: Platform::IDEAL,
    };
    point
        .run(seed)
        .map_err(|e| Failure::Usage(e.to_string()).context("simulating this load"))
}

#[cfg(test)]
mod tests {
    use super::super::{MS, theory};
    use super::*;

    #[test]
    fn distance_is_to_the_nearest_run() {
        let answers = Answers::of(vec![35, 27, 31]);
        assert_eq!((answers.median, answers.min, answers.max), (31, 27, 35));
        let distances = [25, 27, 30, 36].map(|measured| answers.distance(measured));
        assert_eq!(distances, [2, 0, 0, 1]);
    }

    #[test]
    fn simulation_and_theory_agree_within_one_answer() {
        let sleeps = (0..=90).step_by(10).map(Spec::work_conserving);
        let budgets = (1..=9).map(|b| Spec::paper(b * 10 * MS, 100 * MS));
        let odd = [
            Spec::paper(37 * MS, 90 * MS),
            Spec::paper(3 * MS, 7 * MS),
            Spec::fifo(100 * MS),
        ];
        for spec in sleeps.chain(budgets).chain(odd) {
            let grid = Grid::windowed(0, spec.period, spec.interval);
            let theory = theory::per_window(&spec, &grid, grid.messages());
            let simulated = per_window(&spec, &grid, &Costs::default()).unwrap();
            let differ = simulated.high.median.abs_diff(theory.high_answers);
            assert!(differ <= 1, "{spec:?}: {simulated:?} {theory:?}");
            let differ = simulated.low.median.abs_diff(theory.low_answers);
            // A low callback that only sleeps takes turns with high in many ways.
            let allowed = if spec.low_sleep_percent < 75 { 1 } else { 8 };
            assert!(differ <= allowed, "{spec:?}: {simulated:?} {theory:?}");
        }
    }
}

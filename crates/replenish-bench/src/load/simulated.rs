//! The simulator's answers of a window: the same load on the same budget servers, in virtual time.
//!
//! The simulator is given two measurements of the machine from the same run: when each message was
//! taken ([`Arrivals`]), and the costs of a message and an answer ([`Costs`]). Nothing is fitted to
//! the number of answers.
//!
//! Arrivals are replayed, not drawn: when the low callback sleeps for nearly all of its time, it
//! takes its turns in the some 50 us between two bursts of the high one, so that a message 20 us
//! later is an answer less.

use super::Nanos;
use super::grid::Grid;
use super::spec::{High, Spec};
use crate::paper::Point;
use replenish_cli::outcome::Failure;
use replenish_sim::{Platform, Releases};

/// CPU time that this machine adds to the work of callbacks, in ns on average.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Costs {
    /// Dispatcher and enforcer, per message.
    pub dispatch: Nanos,
    /// The high worker, for receiving, decoding and answering.
    pub high: Nanos,
    /// The low worker, before the work of its callback: receiving and decoding.
    pub low: Nanos,
    /// The low worker, after its work: falling asleep, waking up, answering.
    pub low_after: Nanos,
    /// The median lateness of a wake-up from a callback's sleep: time, not CPU time.
    pub wake_up: Nanos,
}

/// From the sending of each message of a topic to its taking, in ns, window by window; 0: unknown.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Arrivals(pub Vec<Vec<u32>>);

impl Arrivals {
    /// Times at which the dispatcher began with the messages of window `index`, from its start on:
    /// it has consumed `dispatch` for a message when it is taken. A message that no callback saw
    /// came as late as the one before it.
    fn of_window(&self, index: u64, grid: &Grid, dispatch: Nanos) -> Releases {
        let window = usize::try_from(index).ok().and_then(|w| self.0.get(w));
        let (mut at, mut late) = (0, 0);
        let times = (0..grid.messages()).zip(0..).map(|(message, i)| {
            let taken = window.and_then(|w: &Vec<u32>| w.get::<usize>(i));
            late = taken
                .map(|t| Nanos::from(*t))
                .filter(|t| *t > 0)
                .unwrap_or(late);
            let begun = late.saturating_sub(dispatch);
            at = at.max(message.saturating_mul(grid.interval).saturating_add(begun));
            at
        });
        Releases::At(times.collect())
    }
}

/// Measurements of the machine that the simulator is given.
#[derive(Debug, Clone)]
pub(crate) struct Measured<'a> {
    /// The costs of messages and answers.
    pub costs: Costs,
    /// Arrivals of the messages: of topic high, of topic low.
    pub arrivals: [&'a Arrivals; 2],
}

/// Answers of one window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Prediction {
    /// To the topic with the budget.
    pub high: u64,
    /// To the other one.
    pub low: u64,
}

/// Simulates window `index` of the load `spec` on `grid`.
///
/// # Errors
/// A value of the load that the simulator's budget server does not take, by name.
pub(crate) fn window(
    spec: &Spec,
    grid: &Grid,
    index: u64,
    measured: &Measured<'_>,
) -> Result<Prediction, Failure> {
    let reservation = match spec.high {
        High::Sporadic {
            budget,
            period,
            background,
        } => Some((budget, period, background)),
        High::Fifo => None,
    };
    let costs = &measured.costs;
    let [high, low] = measured.arrivals;
    // Without a sleep there is no work after a sleep.
    let sleep = Some(spec.low_sleep()).filter(|s| *s > 0);
    let point = Point {
        reservation,
        dispatch: costs.dispatch,
        high: spec.net(spec.burst).saturating_add(costs.high),
        low: spec.net(spec.low_burn()).saturating_add(costs.low),
        low_sleep: sleep.map_or(0, |s| s.saturating_add(costs.wake_up)),
        low_after_sleep: costs.low_after,
        arrivals_high: high.of_window(index, grid, costs.dispatch),
        arrivals_low: low.of_window(index, grid, costs.dispatch),
        window: grid.window,
        platform: Platform::IDEAL,
    };
    let counts = point
        .run(0) // nothing is drawn
        .map_err(|e| Failure::Usage(e.to_string()).context("simulating this load"))?;
    Ok(Prediction {
        high: counts.high_answers,
        low: counts.low_answers,
    })
}

#[cfg(test)]
mod tests {
    use super::super::{MS, theory};
    use super::*;

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
            let none = Arrivals::default();
            let ideal = Measured {
                costs: Costs::default(),
                arrivals: [&none, &none],
            };
            let simulated = window(&spec, &grid, 0, &ideal).unwrap();
            let differ = simulated.high.abs_diff(theory.high_answers);
            assert!(differ <= 1, "{spec:?}: {simulated:?} {theory:?}");
            let differ = simulated.low.abs_diff(theory.low_answers);
            // A low callback that only sleeps takes turns with high in many ways.
            let allowed = if spec.low_sleep_percent < 75 { 1 } else { 8 };
            assert!(differ <= allowed, "{spec:?}: {simulated:?} {theory:?}");
        }
    }

    #[test]
    fn arrivals_are_replayed_in_order_and_what_is_unknown_is_as_late_as_the_one_before() {
        let grid = Grid {
            epoch: 0,
            window: 50,
            pause: 10,
            interval: 10,
        };
        let arrivals = Arrivals(vec![vec![], vec![3, 15, 0, 2, 0]]);
        let at = |w| arrivals.of_window(w, &grid, 0);
        assert_eq!(at(0), Releases::At(vec![0, 10, 20, 30, 40]));
        assert_eq!(at(1), Releases::At(vec![3, 25, 35, 35, 42]));
        assert_eq!(at(9), at(0));
        let begun = arrivals.of_window(1, &grid, 4);
        assert_eq!(begun, Releases::At(vec![0, 21, 31, 31, 40]));
    }
}

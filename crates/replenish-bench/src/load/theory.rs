//! Answers that a window must give if budgets hold exactly and nothing else needs the CPU.
//!
//! With a backlog on both topics a window of `n` periods gives the high worker `n · B` at its
//! high priority; the low worker has what is left; if that is more than it asks for, the high
//! worker continues in the background. An answer needs a whole burst inside the window, so
//! counts are rounded down.

use super::Nanos;
use super::grid::Grid;
use super::spec::{High, Spec};

/// The theoretical outcome of one window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Theory {
    /// CPU time of the high worker at its high priority.
    pub high_priority: Nanos,
    /// CPU time of the high worker at its background priority.
    pub background: Nanos,
    /// CPU time of the low worker.
    pub low: Nanos,
    /// Answers to the high topic.
    pub high_answers: u64,
    /// Answers to the low topic.
    pub low_answers: u64,
}

/// Theory for one window in which `messages` messages were sent on each topic.
///
/// For a low callback that sleeps (Experiment 2) the low worker asks for `1 − x` of the time
/// that the high priority leaves, and gets one answer per burst of that time; the published
/// formula `B/T + (1 − B/T)·x` follows for the high worker.
pub(crate) fn per_window(spec: &Spec, grid: &Grid, messages: u64) -> Theory {
    let window = grid.window;
    let demand = messages.saturating_mul(spec.burst).min(window);
    let guaranteed = match spec.high {
        // A window may hold part of a period when load is continuous.
        High::Sporadic { budget, period, .. } => {
            let whole = (window / period.max(1)).saturating_mul(budget);
            whole.saturating_add((window % period.max(1)).min(budget))
        }
        High::Fifo => window,
    };
    let high_priority = demand.min(guaranteed);
    let left = window - high_priority;
    let low_busy = messages.saturating_mul(spec.burst).min(left); // burning or asleep
    let low = share(low_busy, spec.low_burn(), spec.burst);
    let background = (demand - high_priority).min(left - low);
    let count = |time: Nanos| {
        time.checked_div(spec.burst)
            .unwrap_or(messages)
            .min(messages)
    };
    Theory {
        high_priority,
        background,
        low,
        high_answers: count(high_priority + background),
        low_answers: count(low_busy),
    }
}

/// `time · part / whole` without overflow.
fn share(time: Nanos, part: Nanos, whole: Nanos) -> Nanos {
    if whole == 0 {
        return 0;
    }
    let exact = u128::from(time) * u128::from(part) / u128::from(whole);
    Nanos::try_from(exact).unwrap_or(Nanos::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::MS;
    use super::*;

    fn theory(spec: &Spec) -> Theory {
        let grid = Grid::windowed(0, spec.period, spec.interval);
        per_window(spec, &grid, grid.messages())
    }

    #[test]
    fn the_papers_budgets_give_a_straight_line() {
        for b in 1..=9 {
            let t = theory(&Spec::paper(b * 10 * MS, 100 * MS));
            assert_eq!((t.high_answers, t.low_answers), (4 * b, 40 - 4 * b));
            assert_eq!(t.high_priority + t.low, 400 * MS);
            assert_eq!(t.background, 0);
        }
    }

    #[test]
    fn odd_values_count_whole_bursts_only() {
        let t = theory(&Spec::paper(37 * MS, 90 * MS)); // 4 periods in 360 ms
        assert_eq!(t.high_priority, 148 * MS);
        assert_eq!((t.high_answers, t.low_answers), (14, 21));

        let t = theory(&Spec::paper(3 * MS, 7 * MS)); // 57 periods in 399 ms
        assert_eq!(t.high_priority, 171 * MS);
        assert_eq!((t.high_answers, t.low_answers), (17, 22));
    }

    #[test]
    fn a_full_budget_and_fifo_starve_the_low_worker() {
        for spec in [Spec::paper(100 * MS, 100 * MS), Spec::fifo(100 * MS)] {
            let t = theory(&spec);
            assert_eq!((t.high_answers, t.low_answers, t.low), (40, 0, 0));
        }
    }

    #[test]
    fn sleep_of_the_low_worker_goes_to_the_background() {
        for x in [0_u8, 10, 25, 50, 75, 90, 100] {
            let t = theory(&Spec::work_conserving(x));
            let high_percent = (t.high_priority + t.background) * 100 / (4 * MS);
            assert_eq!(
                high_percent,
                3_000 + 70 * u64::from(x),
                "x = {x} %, in 1/100 %"
            );
        }
    }

    #[test]
    fn demand_limits_what_is_used() {
        let spec = Spec {
            burst: 2 * MS,
            ..Spec::paper(30 * MS, 100 * MS)
        };
        let t = theory(&spec); // 20 ms asked for per period
        assert_eq!(
            (t.high_priority, t.background, t.low),
            (80 * MS, 0, 80 * MS)
        );
        assert_eq!((t.high_answers, t.low_answers), (40, 40));
    }

    #[test]
    fn a_raster_that_cuts_a_period_counts_what_fits() {
        let spec = Spec::paper(37 * MS, 90 * MS);
        let grid = Grid::continuous(0, spec.interval); // 1000 ms = 11 periods and 10 ms
        assert_eq!(
            per_window(&spec, &grid, 100).high_priority,
            (11 * 37 + 10) * MS
        );
    }
}

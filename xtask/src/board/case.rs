//! The cases: which workers run, and how many bursts of 10 ms theory gives each.

use clap::ValueEnum as _;

/// The measured time of every case.
pub(crate) const LENGTH_MS: u64 = 10_000;
/// The CPU time of a burst.
pub(crate) const BURST_MS: u64 = 10;

/// The experiments on the board.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(crate) enum Name {
    /// Experiment 1's sweep: budgets of 10 to 90 ms every 100 ms, and a FIFO worker below.
    BudgetSweep,
    /// Budgets that fit no tick: 37/90, 1/7; as long as the period; and none at all, both FIFO.
    OddBudgets,
    /// Two, three and four budgeted workers that start 0, 1, 3, 10 and 30 ms apart.
    Offsets,
    /// A worker in an endless loop, with a budget, beside one that works.
    Runaway,
    /// The sweep on the executor: pings, answers, dispatcher and enforcer in one image.
    Executor,
    /// Experiment 2: the low callback sleeps for a part of its time, which goes to the high worker.
    WorkConserving,
    /// Two budgeted workers beside one whose topic is flooded.
    Flood,
    /// The agent is killed while the board answers, and another one started.
    Restart,
    /// Damaged bits on the line: each reliable sample arrives once, losses of the others are
    /// counted.
    Noise,
}

/// The name on the command line.
pub(crate) fn label(name: Name) -> String {
    let value = name.to_possible_value();
    value.map_or_else(String::new, |v| v.get_name().to_string())
}

/// One worker: `budget` 0 is one without.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Worker {
    pub(crate) priority: u8,
    pub(crate) budget: u64,
    pub(crate) period: u64,
    pub(crate) offset: u64,
    pub(crate) endless: bool,
}

impl Worker {
    fn budgeted(priority: u8, budget: u64, period: u64, offset: u64) -> Self {
        Self {
            priority,
            budget,
            period,
            offset,
            endless: false,
        }
    }

    /// As the image reads it. The background priority, 6, is below the worker without a budget.
    pub(crate) fn word(&self) -> String {
        let end = if self.endless { "!" } else { "" };
        let Self {
            priority,
            budget,
            period,
            offset,
            ..
        } = self;
        if *budget == 0 {
            format!("{priority}{end}")
        } else {
            format!("{priority}/6/{budget}/{period}@{offset}{end}")
        }
    }

    /// CPU time that its budget gives it until the end, in ms: it always has work, so every period
    /// that begins with its start brings one budget.
    /// Without a budget, but for the last, it is the highest, and has all.
    fn entitled(&self, length: u64) -> u64 {
        if self.budget == 0 {
            return length;
        }
        let left = length.saturating_sub(self.offset);
        left / self.period * self.budget + (left % self.period).min(self.budget)
    }
}

/// A worker that uses the CPU time that the others leave.
const REST: Worker = Worker {
    priority: 10,
    budget: 0,
    period: 0,
    offset: 0,
    endless: false,
};

/// A worker with a budget, and one that takes the rest.
pub(crate) fn pair(budget: u64, period: u64) -> Vec<Worker> {
    vec![Worker::budgeted(60, budget, period, 0), REST]
}

/// Two workers without budgets: the high one has everything.
pub(crate) fn both_fifo() -> Vec<Worker> {
    vec![Worker::budgeted(60, 0, 0, 0), REST]
}

/// Two workers with 30 ms every 100 ms, and one that takes the rest.
pub(crate) fn three() -> Vec<Worker> {
    let budgeted = |priority| Worker::budgeted(priority, 30, 100, 0);
    vec![budgeted(60), budgeted(50), REST]
}

/// The cases of an experiment; the last worker of each is the one that takes the rest.
pub(crate) fn cases(name: Name) -> Vec<Vec<Worker>> {
    match name {
        Name::WorkConserving | Name::Restart => vec![pair(30, 100)],
        Name::Flood => vec![three()],
        Name::BudgetSweep => (1..=9).map(|b| pair(b * 10, 100)).collect(),
        Name::OddBudgets => {
            vec![pair(37, 90), pair(1, 7), pair(100, 100), both_fifo()]
        }
        Name::Offsets => {
            let mut all = Vec::new();
            for (workers, budget) in [(2_u8, 30), (3, 25), (4, 20)] {
                for apart in [0, 1, 3, 10, 30] {
                    let budgeted = (0..workers)
                        .map(|i| Worker::budgeted(60 - i, budget, 100, u64::from(i) * apart));
                    all.push(budgeted.chain([REST]).collect());
                }
            }
            all
        }
        Name::Executor | Name::Noise => Vec::new(), // their images are others: see there
        Name::Runaway => {
            let mut mad = Worker::budgeted(60, 30, 100, 0);
            mad.endless = true;
            vec![vec![mad, Worker::budgeted(50, 30, 100, 0), REST]]
        }
    }
}

/// CPU time that each worker is to get in [`LENGTH_MS`], in ms.
pub(crate) fn expected(case: &[Worker]) -> Vec<f64> {
    expected_in(case, LENGTH_MS)
}

/// CPU time that each worker is to get in `length` ms, in ms.
pub(crate) fn expected_in(case: &[Worker], length: u64) -> Vec<f64> {
    let above = case.len().saturating_sub(1);
    let mut ms: Vec<_> = case.iter().map(|w| w.entitled(length)).collect();
    let taken: u64 = ms.iter().take(above).sum();
    if let Some(rest) = ms.last_mut() {
        *rest = length.saturating_sub(taken);
    }
    ms.into_iter().map(|ms| ms as f64).collect()
}

/// The paper's two experiments have a figure.
pub(crate) fn is_drawn(name: Name) -> bool {
    matches!(name, Name::BudgetSweep | Name::WorkConserving)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_period_counts_as_far_as_it_goes() {
        let worker = Worker::budgeted(60, 37, 90, 0);
        assert_eq!(worker.entitled(LENGTH_MS), 111 * 37 + 10);
        assert_eq!(worker.word(), "60/6/37/90@0");
        assert_eq!(expected(&[worker, REST])[1], (LENGTH_MS - 4117) as f64);
    }

    #[test]
    fn without_budgets_the_high_one_has_everything() {
        assert_eq!(expected(&both_fifo()), [LENGTH_MS as f64, 0.0]);
        assert_eq!(both_fifo()[0].word(), "60");
    }

    #[test]
    fn every_case_ends_with_the_worker_for_the_rest() {
        for name in [
            Name::BudgetSweep,
            Name::OddBudgets,
            Name::Offsets,
            Name::Runaway,
            Name::WorkConserving,
            Name::Flood,
        ] {
            for case in cases(name) {
                assert_eq!(case.last().map(Worker::word), Some(REST.word()));
                assert!(expected(&case).iter().all(|ms| *ms >= 0.0));
            }
        }
    }
}

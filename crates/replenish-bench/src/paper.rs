//! The paper's two experiments as systems: what one window of load must give on Linux.
//!
//! Two topics, one message each per interval, two workers on one CPU: the high one in a
//! reservation (or FIFO), the low one FIFO between its high and its background priority. A
//! dispatcher above both takes the messages.

use replenish_sim::{
    Nanos, Options, Platform, Policy, Releases, SimError, Span, Step, System, Thread, simulate,
};
use sporadic::{Low, ParamError, Params};

/// Priority of the dispatcher on Linux (110 in the paper).
const DISPATCHER: u8 = 98;
/// Priority of the worker with the budget.
const HIGH: u8 = 60;
/// Priority of the other worker.
const LOW: u8 = 50;
/// Messages that may wait: all of a window.
const QUEUE: usize = usize::MAX;

/// One point of an experiment. Times in ns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Point {
    /// The high worker's budget, period and background priority; `None`: FIFO.
    pub reservation: Option<(Nanos, Nanos, u8)>,
    /// CPU time of the dispatcher for a message.
    pub dispatch: Nanos,
    /// CPU time of the high worker for an answer.
    pub high: Nanos,
    /// CPU time of the low worker for an answer.
    pub low: Nanos,
    /// Sleep of the low worker in each answer, after that (experiment 2).
    pub low_sleep: Nanos,
    /// CPU time of the low worker for the answer after its sleep.
    pub low_after_sleep: Nanos,
    /// Times at which the messages of topic high arrive, from the start of the window on.
    pub arrivals_high: Releases,
    /// The same for topic low.
    pub arrivals_low: Releases,
    /// Time in ns in which load is offered; answers count that are complete by then.
    pub window: Nanos,
    /// Costs and delays of the machine.
    pub platform: Platform,
}

impl Point {
    /// Experiment 1: bursts of 10 ms, a message each 10 ms, windows of 400 ms, 100 ms periods.
    pub const fn experiment_1(budget: Nanos) -> Self {
        const MS: Nanos = 1_000_000;
        const EVERY_10_MS: Releases = Releases::Periodic {
            offset: 0,
            period: 10 * MS,
            jitter: 0,
        };
        Self {
            reservation: Some((budget, 100 * MS, 6)),
            dispatch: 0,
            high: 10 * MS,
            low: 10 * MS,
            low_sleep: 0,
            low_after_sleep: 0,
            arrivals_high: EVERY_10_MS,
            arrivals_low: EVERY_10_MS,
            window: 400 * MS,
            platform: Platform::IDEAL,
        }
    }

    /// Experiment 2: 30 of 100 ms, and the low callback sleeps for a part of its 10 ms, in percent
    /// up to 100.
    pub fn experiment_2(low_sleep_percent: u8) -> Self {
        const MS: Nanos = 1_000_000;
        let mut point = Self::experiment_1(30 * MS);
        point.reservation = Some((30 * MS, 100 * MS, 10));
        point.low_sleep = point.low * Nanos::from(low_sleep_percent.min(100)) / 100;
        point.low -= point.low_sleep;
        point
    }

    /// Simulates one window, with full budgets at its start; `seed` is for jitter.
    ///
    /// # Errors
    /// A field is out of its range, by name.
    pub fn run(&self, seed: u64) -> Result<Counts, SimError> {
        let outcome = simulate(&self.system()?, &Options::until(self.window).seed(seed))?;
        let [_, _, high, low] = &outcome.threads[..] else {
            return Ok(Counts::default());
        };
        Ok(Counts {
            high_answers: high.completed,
            low_answers: low.completed,
            high_priority: high.cpu_high,
            background: high.cpu_low,
            low: low.cpu(),
        })
    }

    /// The system: a dispatcher per topic, the high and the low worker.
    ///
    /// # Errors
    /// The budget is not one.
    pub fn system(&self) -> Result<System, SimError> {
        let wrong = |message: String| replenish_sim::SpecError {
            thread: None,
            message,
        };
        let policy = match self.reservation {
            None => Policy::Fifo { priority: HIGH },
            Some((budget, period, background)) => Policy::Sporadic(
                Params::new(HIGH, Low::Background(background), budget, period, 100)
                    .map_err(|error: ParamError| wrong(error.to_string()))?,
            ),
        };
        let dispatcher = |name: &str, arrivals: &Releases, worker| {
            Thread::new(
                name,
                Policy::Fifo {
                    priority: DISPATCHER,
                },
            )
            .released(arrivals.clone())
            .runs(self.dispatch)
            .then(Step::Send(worker))
            .queue(QUEUE)
        };
        let low = Thread::new("low", Policy::Fifo { priority: LOW })
            .runs(self.low)
            .then(Step::Block(Span::Constant(self.low_sleep)))
            .runs(self.low_after_sleep)
            .queue(QUEUE);
        Ok(System {
            cpus: 1,
            locks: 0,
            platform: self.platform.clone(),
            threads: vec![
                dispatcher("dispatch high", &self.arrivals_high, 2),
                dispatcher("dispatch low", &self.arrivals_low, 3),
                Thread::new("high", policy).runs(self.high).queue(QUEUE),
                low,
            ],
        })
    }
}

/// The results of one window. CPU times in ns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Answers to the high topic.
    pub high_answers: u64,
    /// Answers to the low topic.
    pub low_answers: u64,
    /// CPU time of the high worker at its high priority.
    pub high_priority: Nanos,
    /// CPU time of the high worker at its background priority.
    pub background: Nanos,
    /// CPU time of the low worker.
    pub low: Nanos,
}

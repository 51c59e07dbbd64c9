//! The paper's two experiments as systems: what one window of load must give on Linux.
//!
//! Two topics, one message each per interval, two workers on one CPU: the high one in a
//! reservation (or FIFO), the low one FIFO between its high and its background priority. A
//! dispatcher above both takes the messages.

use crate::{
    Nanos, Options, Platform, Policy, Releases, SimError, Span, Step, System, Thread, simulate,
};
use sporadic::{Kind, Low, ParamError, Params};

/// Priority of the dispatcher on Linux (110 in the paper).
const DISPATCHER: u8 = 98;
/// Priority of the worker with the budget.
const HIGH: u8 = 60;
/// Priority of the other worker.
const LOW: u8 = 50;

/// One point of an experiment. Times in ns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Point {
    /// The high worker's budget, period and background priority; `None`: FIFO.
    pub reservation: Option<(Nanos, Nanos, u8)>,
    /// What an answer takes of the CPU, the dispatcher's part included.
    pub burst: Nanos,
    /// The dispatcher's part of it.
    pub dispatch: Nanos,
    /// The part of a low answer that is slept instead, in percent (experiment 2).
    pub low_sleep_percent: u8,
    /// Time between two messages of a topic.
    pub interval: Nanos,
    /// For how long load is offered; answers count that are complete by then.
    pub window: Nanos,
    /// Costs and delays of the machine.
    pub platform: Platform,
}

impl Point {
    /// Experiment 1: bursts of 10 ms, a message each 10 ms, windows of 400 ms, 100 ms periods.
    pub const fn experiment_1(budget: Nanos) -> Self {
        const MS: Nanos = 1_000_000;
        Self {
            reservation: Some((budget, 100 * MS, 6)),
            burst: 10 * MS,
            dispatch: 0,
            low_sleep_percent: 0,
            interval: 10 * MS,
            window: 400 * MS,
            platform: Platform::IDEAL,
        }
    }

    /// Experiment 2: 30 of 100 ms, and the low callback sleeps.
    pub const fn experiment_2(low_sleep_percent: u8) -> Self {
        const MS: Nanos = 1_000_000;
        let mut point = Self::experiment_1(30 * MS);
        point.reservation = Some((30 * MS, 100 * MS, 10));
        point.low_sleep_percent = low_sleep_percent;
        point
    }

    /// Simulates one window, with full budgets at its start.
    ///
    /// # Errors
    /// A field is out of its range, by name.
    pub fn run(&self) -> Result<Counts, SimError> {
        let outcome = simulate(&self.system()?, &Options::until(self.window))?;
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
    /// The budget is not one, or `low_sleep_percent` is above 100.
    pub fn system(&self) -> Result<System, SimError> {
        let wrong = |message: String| crate::SpecError {
            thread: None,
            message,
        };
        let Some(busy_percent) = 100u8.checked_sub(self.low_sleep_percent) else {
            let percent = self.low_sleep_percent;
            return Err(wrong(format!("low_sleep_percent {percent}: allowed 0 to 100")).into());
        };
        let policy = match self.reservation {
            None => Policy::Fifo { priority: HIGH },
            Some((budget, period, background)) => Policy::Budget {
                kind: Kind::Corrected,
                params: Params::new(HIGH, Low::Background(background), budget, period, 100)
                    .map_err(|error: ParamError| wrong(error.to_string()))?,
            },
        };
        let messages = usize::try_from(self.window / self.interval.max(1)).unwrap_or(usize::MAX);
        let dispatcher = |name: &str, worker| {
            Thread::new(
                name,
                Policy::Fifo {
                    priority: DISPATCHER,
                },
            )
            .released(Releases::periodic(self.interval))
            .runs(self.dispatch)
            .then(Step::Send(worker))
            .queue(messages)
        };
        let net = self.burst.saturating_sub(self.dispatch);
        let busy = net * Nanos::from(busy_percent) / 100;
        let low = Thread::new("low", Policy::Fifo { priority: LOW })
            .runs(busy)
            .then(Step::Block(Span::Constant(net - busy)))
            .queue(messages);
        Ok(System {
            cpus: 1,
            locks: 0,
            platform: self.platform.clone(),
            threads: vec![
                dispatcher("dispatch high", 2),
                dispatcher("dispatch low", 3),
                Thread::new("high", policy).runs(net).queue(messages),
                low,
            ],
        })
    }
}

/// What one window gave. CPU times in ns.
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

//! Prepares a trace for drawing: the time in which each thread ran, and the budget that it had
//! left.

use crate::commands::plan::short;
use replenish_plan::Nanos;
use replenish_sim::{Event, Outcome, Policy, System, What};
use sporadic::Level;

/// One thread's row of the drawing. Times in ns.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::commands) struct Lane {
    pub(in crate::commands) name: String,
    /// Its scheduling, in a few words.
    pub(in crate::commands) policy: String,
    /// Its CPU by its place in the system; `None`: any.
    pub(in crate::commands) cpu: Option<usize>,
    pub(in crate::commands) bars: Vec<Bar>,
    /// CPU time left in its budget, as corners of a line; empty without a budget.
    pub(in crate::commands) budget: Vec<(Nanos, Nanos)>,
    /// The whole budget.
    pub(in crate::commands) full: Nanos,
    pub(in crate::commands) releases: Vec<Nanos>,
    /// Ends of callbacks that were late.
    pub(in crate::commands) late: Vec<Nanos>,
}

/// A stretch of time on a CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::commands) struct Bar {
    pub(in crate::commands) from: Nanos,
    pub(in crate::commands) to: Nanos,
    /// Without budget, at the background priority.
    pub(in crate::commands) background: bool,
}

/// The lanes of a traced run, in the order of the system.
pub(in crate::commands) fn of(system: &System, outcome: &Outcome) -> Vec<Lane> {
    let threads = system.threads.iter().enumerate();
    threads
        .map(|(id, thread)| {
            let (full, policy) = match &thread.policy {
                Policy::Other => (0, "time-shared".to_string()),
                Policy::Fifo { priority } | Policy::RoundRobin { priority } => {
                    (0, format!("FIFO {priority}"))
                }
                Policy::Sporadic(params) | Policy::KernelSporadic(params) => (
                    params.budget(),
                    format!(
                        "{}, priority {}",
                        budget(params.budget(), params.period()),
                        params.priority()
                    ),
                ),
                Policy::Deadline {
                    runtime, period, ..
                } => (0, format!("deadline {}", budget(*runtime, *period))),
            };
            let mut lane = Lane {
                name: thread.name.clone(),
                policy,
                cpu: thread.cpu,
                bars: Vec::new(),
                budget: Vec::new(),
                full,
                releases: Vec::new(),
                late: Vec::new(),
            };
            let events = outcome.trace.iter().filter(|e| e.thread == id);
            lane.follow(events, thread.deadline, outcome.horizon);
            lane
        })
        .collect()
}

impl Lane {
    fn follow<'e>(
        &mut self,
        events: impl Iterator<Item = &'e Event>,
        deadline: Option<Nanos>,
        horizon: Nanos,
    ) {
        let mut since = None;
        let mut background = false;
        for event in events {
            let now = event.time;
            match event.what {
                What::Release => self.releases.push(now),
                What::Run { .. } => {
                    since = Some(now);
                    self.hold(now);
                }
                What::Preempt { .. } | What::Yield { .. } => {
                    self.bar(since.take(), now, background);
                }
                What::Level(level) => {
                    self.bar(since, now, background);
                    since = since.map(|_| now);
                    background = level == Level::Low;
                }
                What::Budget { left } => self.budget.push((now, left)),
                What::Complete { response } if deadline.is_some_and(|d| response > d) => {
                    self.late.push(now);
                }
                _ => {}
            }
        }
        self.bar(since, horizon, background);
        self.hold(horizon);
    }

    fn bar(&mut self, from: Option<Nanos>, to: Nanos, background: bool) {
        let Some(from) = from.filter(|from| *from < to) else {
            return;
        };
        match self.bars.last_mut() {
            Some(last) if last.to == from && last.background == background => last.to = to,
            _ => self.bars.push(Bar {
                from,
                to,
                background,
            }),
        }
    }

    /// Until now the budget stayed as it was.
    fn hold(&mut self, now: Nanos) {
        if let Some(&(_, left)) = self.budget.last() {
            self.budget.push((now, left));
        }
    }
}

/// A budget for people: `30 ms / 100 ms`.
fn budget(amount: Nanos, period: Nanos) -> String {
    format!("{} / {}", short(amount), short(period))
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_sim::{Options, Releases, Thread, simulate};
    use sporadic::{Low, Params};

    const MS: Nanos = 1_000_000;

    #[test]
    fn bars_add_up_to_the_cpu_time_and_the_budget_line_never_slants_upwards() {
        let params = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 16).unwrap();
        let policy = Policy::Sporadic(params);
        let system = System::on_one_cpu(vec![
            Thread::new("high", policy)
                .released(Releases::periodic(50 * MS))
                .runs(25 * MS)
                .due_within(30 * MS),
            Thread::new("low", Policy::Fifo { priority: 50 })
                .released(Releases::periodic(50 * MS))
                .runs(20 * MS),
        ]);
        let options = Options::until(400 * MS).traced();
        let outcome = simulate(&system, &options).unwrap();
        let lanes = of(&system, &outcome);
        for (lane, thread) in lanes.iter().zip(&outcome.threads) {
            let sum = |background| -> Nanos {
                let bars = lane.bars.iter().filter(|b| b.background == background);
                bars.map(|b| b.to - b.from).sum()
            };
            assert_eq!(sum(false), thread.cpu_high, "{}", lane.name);
            assert_eq!(sum(true), thread.cpu_low, "{}", lane.name);
            assert_eq!(lane.late.len() as u64, thread.misses);
            assert_eq!(lane.releases.len(), 8);
        }
        assert!(outcome.threads[0].misses > 0 && outcome.threads[0].cpu_low > 0);
        for pair in lanes[0].budget.windows(2) {
            let ((from, before), (to, after)) = (pair[0], pair[1]);
            assert!(after <= before || from == to, "{:?}", lanes[0].budget);
            assert!(after <= lanes[0].full);
        }
        assert!(lanes[1].budget.is_empty());
    }
}

//! Makes the simulator's system from a file and its plan.

use super::deployment::{Deployment, Described};
use crate::{Hold, Nanos, Plan, Requirement};
use replenish_sim::{Releases, Span, Step, System, Thread};

impl Deployment {
    /// The system as planned. Thread `i` is worker `i`; behind them come the budgets of programs,
    /// used up in every period, and last the executor, if it has a budget, as busy as the releases
    /// make it. CPU `i` of the system is the `i`-th of
    /// `machine.cpus`.
    ///
    /// Gaps in the file are filled in: callbacks of a rate come at that rate and take the stated
    /// time; those of a budget come once per period and use it up, but for the overheads.
    #[must_use]
    pub fn system(&self, plan: &Plan) -> System {
        let cpus = &self.machine.cpus;
        let place = |cpu: Option<usize>| cpu.and_then(|cpu| cpus.iter().position(|c| *c == cpu));
        let workers = self.workers.iter().zip(&plan.workers);
        let mut threads: Vec<Thread> = workers
            .map(|(described, planned)| {
                let mut thread = Thread::new(&*described.name, planned.policy);
                thread.cpu = place(planned.cpu);
                thread.deadline = planned.deadline;
                self.fill(&mut thread, described, planned.amount);
                thread
            })
            .collect();
        let foreign = plan.workers.iter().skip(self.workers.len());
        threads.extend(foreign.map(|planned| {
            let mut thread = Thread::new(&*planned.name, planned.policy);
            thread.cpu = place(planned.cpu);
            if let Some(params) = planned.policy.params() {
                thread.releases = Releases::periodic(params.period());
                thread.body = vec![Step::Run(Span::Constant(params.budget()))];
            }
            thread
        }));
        if let Some(executor) = &plan.executor
            && let Some(params) = executor.policy.params()
        {
            let mut thread = Thread::new("executor", executor.policy);
            thread.cpu = place(executor.cpu);
            let busy = self.dispatching(params.period()).min(params.budget());
            thread.releases = Releases::periodic(params.period());
            thread.body = vec![Step::Run(Span::Constant(busy))];
            threads.push(thread);
        }
        System {
            cpus: cpus.len(),
            locks: self.locks.len(),
            platform: self.machine.overheads.platform(),
            threads,
        }
    }

    fn fill(&self, thread: &mut Thread, described: &Described, amount: Option<Nanos>) {
        let load = &described.load;
        let guarantee = match &described.scheduling {
            Some(Requirement::Guarantee(guarantee)) => Some(guarantee),
            _ => None,
        };
        thread.releases = match (&load.releases, guarantee) {
            (Some(releases), _) => releases.clone(),
            (None, Some(guarantee)) => Releases::periodic(guarantee.period()),
            (None, None) => Releases::Never,
        };
        thread.queue = load.queue;
        thread.overflow = load.overflow;
        if let Some(blocks) = &load.blocks {
            thread.body.push(Step::Block(blocks.clone()));
        }
        for (lock, holds) in &load.locks {
            if let Some(holds) = holds {
                let held = Step::Run(Span::Constant(*holds));
                let steps = [Step::Lock(*lock), held, Step::Unlock(*lock)];
                thread.body.extend(steps);
            }
        }
        let unstated = |(_, holds): &&(usize, Option<Nanos>)| holds.is_none();
        let mut meanwhile: Vec<usize> = load.locks.iter().filter(unstated).map(|l| l.0).collect();
        meanwhile.sort_unstable(); // all in one order, so that nobody waits in a circle
        meanwhile.dedup();
        thread
            .body
            .extend(meanwhile.iter().map(|lock| Step::Lock(*lock)));
        let all = amount
            .or(guarantee.map(crate::Guarantee::amount))
            .unwrap_or(0);
        let runs = load.runs.clone().unwrap_or_else(|| {
            let costs = self.machine.overheads.costs(true);
            let around = costs.overrun(all) + costs.slack(all);
            let around = costs.job + 4 * costs.context_switch + around;
            Span::Constant(match guarantee {
                Some(guarantee) if !guarantee.is_rate() => all.saturating_sub(around),
                _ => all,
            })
        });
        thread.body.push(Step::Run(runs));
        let unlocks = meanwhile.iter().rev().map(|lock| Step::Unlock(*lock));
        thread.body.extend(unlocks);
        thread
            .body
            .extend(load.sends.iter().map(|to| Step::Send(*to)));
    }

    /// CPU time the executor needs in a period at the mean rate of all that come as messages.
    fn dispatching(&self, period: Nanos) -> Nanos {
        let mean = |worker: &Described| match &worker.load.releases {
            _ if worker.handles.iter().all(|h| h.contains("/timer:"))
                && !worker.handles.is_empty() =>
            {
                0.0
            }
            Some(Releases::Periodic { period, .. }) => 1.0 / *period as f64,
            Some(Releases::Sporadic { gap, .. }) => 2.0 / (gap.min() + gap.max()).max(1) as f64,
            Some(Releases::Bursty { period, burst, .. }) => f64::from(*burst) / *period as f64,
            Some(Releases::At(_) | Releases::Never) => 0.0,
            None => match &worker.scheduling {
                Some(Requirement::Guarantee(guarantee)) => 1.0 / guarantee.period() as f64,
                _ => 0.0,
            },
        };
        let messages = self.workers.iter().map(mean).sum::<f64>() * period as f64;
        #[expect(clippy::cast_sign_loss, reason = "a number of messages")]
        let messages = messages.ceil() as Nanos;
        messages.saturating_mul(self.machine.overheads.dispatch)
    }
}

impl Described {
    /// The locks, for the planner.
    pub(super) fn holds(&self) -> Vec<Hold> {
        let handle = match self.handles.as_slice() {
            [only] => only.as_str(),
            _ => "",
        };
        let hold = |(lock, length): &(usize, Option<Nanos>)| Hold::of(*lock, *length, handle);
        self.load.locks.iter().map(hold).collect()
    }
}

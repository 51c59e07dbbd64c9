//! A request, sorted into what can be chosen and what cannot.

use super::locks::{self, Shared};
use super::placement::{FixedThread, ThreadPlan};
use crate::guarantee::MAX_PERIOD;
use crate::span::Exact;
use crate::{ExecutorRequest, Guarantee, Nanos, Overheads, Request};
use replenish_sim::analysis::Demand;
use sporadic::Policy;

/// The share of a CPU that a planned executor gets: a twentieth.
const EXECUTOR_SHARE: Nanos = 20;
/// Limits of its period.
const EXECUTOR_PERIODS: (Nanos, Nanos) = (1_000_000, 10_000_000);

/// The owner of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Whose {
    Worker(usize),
    Executor,
    Promise(usize),
}

/// The planner's problem.
#[derive(Debug, Clone)]
pub(super) struct Problem<'r> {
    pub(super) request: &'r Request,
    /// Threads to place: the executor first, if it is to be placed, then the guaranteed workers in
    /// order.
    pub(super) threads: Vec<(Whose, ThreadPlan)>,
    /// Threads with given parameters, with their CPU (`None`: any).
    pub(super) fixed: Vec<(Whose, Option<usize>, FixedThread)>,
}

impl<'r> Problem<'r> {
    /// Checks and sorts.
    ///
    /// # Errors
    /// The value that is out of range, in a sentence.
    pub(super) fn new(request: &'r Request) -> Result<Self, String> {
        let mut problem = Self {
            request,
            threads: Vec::new(),
            fixed: Vec::new(),
        };
        problem.check_machine()?;
        problem.add_executor();
        for worker in &request.workers {
            let owner = format!("worker {:?}", worker.name);
            problem.check_cpu(&owner, worker.cpu)?;
            check_demand(&owner, worker)?;
            if worker.holds.iter().any(|h| h.lock >= request.locks.len()) {
                return Err(format!("{owner}: it holds a lock that has no name"));
            }
        }
        let mut shared = locks::shared(request)?.into_iter();
        for (index, worker) in request.workers.iter().enumerate() {
            let shared = shared.next().unwrap_or_default();
            let owner = format!("worker {:?}", worker.name);
            if request
                .workers
                .iter()
                .take(index)
                .any(|w| w.name == worker.name)
            {
                return Err(format!("there are two workers named {:?}", worker.name));
            }
            match (worker.guarantee(), &worker.scheduling) {
                (Some(guarantee), _) => {
                    guarantee.check().map_err(|e| format!("{owner}: {e}"))?;
                    let seat = worker_plan(worker, guarantee, shared);
                    problem.threads.push((Whose::Worker(index), seat));
                }
                (None, crate::Requirement::Policy(policy)) => {
                    problem.check_policy(&owner, policy)?;
                    let fixed = FixedThread {
                        policy: *policy,
                        demand: worker.demand,
                        sections: shared.sections,
                        deadline: worker.deadline,
                        own: true,
                    };
                    problem
                        .fixed
                        .push((Whose::Worker(index), worker.cpu, fixed));
                }
                (None, crate::Requirement::Guarantee(_)) => {}
            }
        }
        for (index, promise) in request.promised.iter().enumerate() {
            let fixed = FixedThread {
                policy: promise.policy,
                demand: promise.demand,
                sections: promise.sections.clone(),
                deadline: promise.deadline,
                own: false,
            };
            problem
                .fixed
                .push((Whose::Promise(index), promise.cpu, fixed));
        }
        Ok(problem)
    }

    fn check_machine(&self) -> Result<(), String> {
        let machine = &self.request.machine;
        let (low, high) = (*machine.priorities.start(), *machine.priorities.end());
        if machine.cpus.is_empty() {
            return Err("machine: cpus is empty: at least one is needed".into());
        }
        if let Some(cpu) = machine.cpus.iter().find(|c| **c > 4095) {
            return Err(format!(
                "machine: cpu {cpu} is out of range: allowed 0 to 4095"
            ));
        }
        let enforcer = machine.enforcer_priority;
        if !(4..=99).contains(&enforcer) {
            return Err(format!(
                "machine: enforcer_priority {enforcer} is out of range: allowed 4 to 99"
            ));
        }
        if low < 2 || low > high || high > enforcer - 2 {
            return Err(format!(
                "machine: priorities {low} to {high} are out of range: allowed 2 to {}, low to high",
                enforcer - 2
            ));
        }
        if machine.overheads.all().iter().any(|o| *o > Overheads::MOST) {
            return Err("machine: an overhead is out of range: allowed up to 1 s".into());
        }
        let share = machine.real_time_share;
        if !(share > 0.0 && share <= 1.0) {
            return Err(format!(
                "machine: real_time_share {share} is out of range: allowed above 0 to 1"
            ));
        }
        Ok(())
    }

    fn check_cpu(&self, owner: &str, cpu: Option<usize>) -> Result<(), String> {
        let cpus = &self.request.machine.cpus;
        match cpu {
            Some(cpu) if !cpus.contains(&cpu) => Err(format!(
                "{owner}: cpu {cpu} is not one the plan may use: allowed {cpus:?}"
            )),
            _ => Ok(()),
        }
    }

    fn check_policy(&self, owner: &str, policy: &Policy) -> Result<(), String> {
        let enforcer = self.request.machine.enforcer_priority;
        if let Some(period) = policy.period().filter(|p| *p > MAX_PERIOD) {
            let (period, most) = (Exact(period), Exact(MAX_PERIOD));
            return Err(format!(
                "{owner}: period {period} is out of range: allowed up to {most}"
            ));
        }
        let Some(priority) = policy.priority() else {
            return Ok(());
        };
        if priority == 0 || priority > 99 {
            return Err(format!(
                "{owner}: priority {priority} is out of range: allowed 1 to 99"
            ));
        }
        if policy.params().is_some() && priority >= enforcer {
            return Err(format!(
                "{owner}: priority {priority} is out of range: allowed 1 to {} (below the enforcer)",
                enforcer - 1
            ));
        }
        Ok(())
    }

    fn add_executor(&mut self) {
        let level = self.request.machine.enforcer_priority - 1;
        match &self.request.executor {
            ExecutorRequest::None => {}
            ExecutorRequest::Policy { policy, cpu } => {
                let fixed = FixedThread {
                    policy: *policy,
                    demand: None,
                    sections: Vec::new(),
                    deadline: None,
                    own: true,
                };
                self.fixed.push((Whose::Executor, *cpu, fixed));
            }
            ExecutorRequest::Planned { cpu } => {
                let period = executor_period(self.request);
                let seat = ThreadPlan {
                    period,
                    deadline: period,
                    per_job: false,
                    importance: u8::MAX,
                    suspend: false,
                    demand: None,
                    waits: false,
                    late: 0,
                    sections: Vec::new(),
                    level: Some(level),
                    cpu: *cpu,
                    together: None,
                };
                self.threads.push((Whose::Executor, seat));
            }
        }
    }

    /// The least and the desired amount of each thread, in ns.
    pub(super) fn amounts(&self) -> (Vec<Nanos>, Vec<Nanos>) {
        let of = |(whose, seat): &(Whose, ThreadPlan)| match whose {
            Whose::Worker(index) => {
                let worker = self.request.workers.get(*index);
                let guarantee = worker.and_then(crate::Worker::guarantee);
                guarantee.map_or((1, 1), |g| (g.minimum(), g.desired()))
            }
            _ => (seat.period / EXECUTOR_SHARE, seat.period / EXECUTOR_SHARE),
        };
        self.threads.iter().map(of).unzip()
    }

    pub(super) fn name(&self, whose: Whose) -> String {
        let of = |index: usize| self.request.workers.get(index).map(|w| w.name.as_str());
        match whose {
            Whose::Worker(index) => format!("worker {:?}", of(index).unwrap_or_default()),
            Whose::Executor => "the executor".into(),
            Whose::Promise(index) => self
                .request
                .promised
                .get(index)
                .map_or_else(String::new, |p| p.owner.clone()),
        }
    }
}

/// All times up to a day, so that sums and products stay within 64 bits.
fn check_demand(owner: &str, worker: &crate::Worker) -> Result<(), String> {
    let mut times = vec![worker.late, worker.deadline.unwrap_or(0)];
    times.extend(worker.holds.iter().filter_map(|h| h.length));
    if let Some(d) = worker.demand {
        if d.cost == 0 || d.period == 0 {
            return Err(format!(
                "{owner}: a demand of 0, or every 0, is out of range"
            ));
        }
        times.extend([d.cost, d.period, d.jitter, d.suspended]);
    }
    if times.into_iter().any(|t| t > MAX_PERIOD) {
        let most = Exact(MAX_PERIOD);
        return Err(format!(
            "{owner}: a time is out of range: allowed up to {most}"
        ));
    }
    Ok(())
}

/// The executor's period: the shortest deadline, so that a message does not wait for the executor's
/// budget longer than its worker may take.
fn executor_period(request: &Request) -> Nanos {
    let deadlines = request.workers.iter().filter_map(|w| w.guarantee());
    let shortest = deadlines.map(Guarantee::due_within).min();
    let (low, high) = EXECUTOR_PERIODS;
    shortest.unwrap_or(high).clamp(low, high)
}

fn worker_plan(worker: &crate::Worker, guarantee: &Guarantee, shared: Shared) -> ThreadPlan {
    let rate = guarantee.is_rate();
    let stated = worker.demand.unwrap_or(Demand::new(1, guarantee.period()));
    let demand = Demand {
        period: guarantee.period(),
        jitter: stated.jitter.saturating_add(worker.late),
        ..stated
    };
    ThreadPlan {
        period: guarantee.period(),
        deadline: guarantee.due_within(),
        per_job: rate,
        importance: guarantee.importance,
        suspend: guarantee.budget().suspend,
        demand: rate.then_some(demand),
        waits: stated.suspensions > 0,
        late: if rate { worker.late } else { 0 },
        sections: shared.sections,
        level: None,
        cpu: worker.cpu.or(shared.cpu),
        together: shared.together,
    }
}

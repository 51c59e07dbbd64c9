//! The threads that delay a thread at a priority, and their delay in a window of a given length.

use super::{Costs, Scheduling, Task};
use crate::Nanos;
use sporadic::Params;

/// `⌈(w + jitter) / period⌉ * cost` in a window of length w (ABRTW93).
#[derive(Debug, Clone, Copy)]
struct Term {
    cost: Nanos,
    period: Nanos,
    jitter: Nanos,
    /// The most switches that one of its jobs causes by taking the CPU.
    switches: u64,
}

/// The delay of a thread at one priority by all others on its CPU.
#[derive(Debug, Default)]
pub(super) struct Interference {
    terms: Vec<Term>,
    /// Once per window.
    constant: Nanos,
    /// The most times that holders of locks take the CPU, per window.
    switches: u64,
    /// The share of the CPU that it takes in the long run.
    rate: f64,
    /// CPU time of others that jitter brings forward, on average, in ns.
    early: f64,
}

impl Interference {
    /// The delay of `tasks[index]` at its own priority; `None` if the delay has no limit.
    ///
    /// - Equal priorities count as higher ones.
    /// - A FIFO thread of higher priority: its jobs, with their switches to it and back (BTW95). If
    ///   it can suspend itself: with the jitter `period - cost`, valid if it meets its period
    ///   (CNH19) (checked by the caller).
    /// - A reservation whose background priority is below: budget per period like a periodic task
    ///   (SSL89, SBWH10), once more by the overrun, with jitter if it is raised late.
    /// - A reservation whose background priority is not below: its jobs, like a FIFO thread.
    /// - Release interrupts and the enforcer, whomever they serve.
    /// - Critical sections of the less urgent, see [`blocking`].
    pub(super) fn of(tasks: &[Task], index: usize, costs: &Costs, locks: &Locks) -> Option<Self> {
        let own = &tasks[index];
        let priority = own.priority();
        let mut result = Self {
            terms: Vec::with_capacity(4 * tasks.len()),
            ..Self::default()
        };
        for (other, task) in tasks.iter().enumerate() {
            result.add_interrupts(task, costs);
            if other == index || task.priority() < priority {
                continue;
            }
            match task.scheduling {
                Scheduling::Reserved(_) if task.low_priority() < Some(priority) => {
                    result.add_reservation(tasks, other, costs, locks, priority);
                }
                _ => result.add_jobs(task, costs)?,
            }
        }
        let windows = 1 + own.demand.map_or(0, |d| u64::from(d.suspensions));
        let blocking = blocking(tasks, priority, costs, locks);
        result.constant += blocking.saturating_mul(windows);
        if blocking > 0 {
            result.switches = windows * 2 * tasks.len() as u64;
        }
        for term in &result.terms {
            let share = term.cost as f64 / term.period as f64;
            result.rate += share;
            result.early += share * term.jitter as f64;
        }
        Some(result)
    }

    fn push(&mut self, cost: Nanos, period: Nanos, jitter: Nanos, switches: u64) {
        if cost == 0 {
            return;
        }
        // One task brings several terms, one after another.
        let recent = self.terms.iter_mut().rev().take(4);
        let mut same = recent.filter(|t| (t.period, t.jitter) == (period, jitter));
        if let Some(term) = same.next() {
            term.cost = term.cost.saturating_add(cost);
            term.switches = term.switches.saturating_add(switches);
            return;
        }
        self.terms.push(Term {
            cost,
            period,
            jitter,
            switches,
        });
    }

    fn add_interrupts(&mut self, task: &Task, costs: &Costs) {
        if let Some(demand) = task.demand {
            let jitter = demand.jitter + costs.tick;
            self.push(costs.release_interrupt, demand.period, jitter, 0);
        }
        if let Scheduling::Reserved(params) = task.scheduling {
            self.push(costs.enforcement, params.period(), params.period(), 0);
        }
    }

    fn add_jobs(&mut self, task: &Task, costs: &Costs) -> Option<()> {
        let demand = task.demand?;
        let cost = job_cost(task, costs);
        let mut jitter = demand.jitter + costs.tick;
        if let Scheduling::Reserved(params) = task.scheduling {
            // Lowered and raised inside a job, it takes the CPU once more.
            let (raises, period) = (raises(&params), params.period());
            self.push(2 * costs.context_switch * raises, period, period, raises);
        }
        if task.suspends() {
            jitter += demand.period.saturating_sub(cost);
        }
        self.push(cost, demand.period, jitter, waits(task) + 1);
        Some(())
    }

    fn add_reservation(
        &mut self,
        tasks: &[Task],
        index: usize,
        costs: &Costs,
        locks: &Locks,
        priority: u8,
    ) {
        let task = &tasks[index];
        let Scheduling::Reserved(params) = task.scheduling else {
            return;
        };
        let (budget, period) = (params.budget(), params.period());
        self.push(budget, period, costs.raise_delay(), 0);
        // Budget that was put off as too little to be used is consumed in a later round.
        self.constant += costs.overrun(budget) + costs.slack(budget);
        let raises = raises(&params);
        // Whom it has preempted pays for being switched to again, once per raise and wake-up. A
        // wake-up has cost the reservation as much, so the budget is a limit, too.
        match task.demand {
            Some(demand) if costs.context_switch > 0 => {
                let wakes = waits(task) + 1;
                let jitter = demand.jitter + demand.period;
                self.push(costs.context_switch * wakes, demand.period, jitter, wakes);
                self.push(costs.context_switch * raises, period, period, raises);
            }
            None if costs.context_switch > 0 => {
                let most = budget.div_ceil(costs.context_switch);
                self.push(budget, period, period, most);
            }
            _ => {}
        }
        // Each time it is lowered it can hold a lock, and is then raised by inheritance, for free;
        // at most in each section of each job, if jobs do not pile up.
        let section = longest_section(task, priority, locks, costs);
        if let Some(demand) = task.demand.filter(|_| locks.settled[index]) {
            let sections = relevant_sections(task, priority, locks, costs);
            let (sum, count) = sections.fold((0, 0), |(sum, n), length| (sum + length, n + 1));
            let by_jobs = u128::from(sum) * u128::from(period);
            let by_raises = u128::from(section * raises) * u128::from(demand.period);
            if by_jobs < by_raises {
                let jitter = demand.jitter + costs.tick + demand.period;
                self.push(sum, demand.period, jitter, count);
                return;
            }
        }
        self.push(section * raises, period, period, raises);
    }

    /// The most times that a thread loses the CPU in a window of this length, in ns.
    pub(super) fn switches_in(&self, window: Nanos) -> u64 {
        let terms = self.terms.iter().map(|t| {
            let jobs = window.saturating_add(t.jitter).div_ceil(t.period);
            jobs.saturating_mul(t.switches)
        });
        terms.fold(self.switches, u64::saturating_add)
    }

    /// The share of the CPU that the interference takes in the long run.
    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    /// Whether `cost` and its interference end within a window of this length, or a shorter one.
    pub(super) fn fits(&self, cost: Nanos, window: Nanos) -> bool {
        if self.rate >= 1.0 {
            return false;
        }
        // Mostly there is room at the end already; otherwise a shorter window may do.
        let of = |t: &Term| {
            let jobs = window.saturating_add(t.jitter).div_ceil(t.period);
            jobs.saturating_mul(t.cost)
        };
        let asked = cost.saturating_add(self.constant);
        let asked = self.terms.iter().map(of).fold(asked, Nanos::saturating_add);
        asked <= window || self.window(cost, 0, window).is_some_and(|w| w <= window)
    }

    /// The shortest window that holds `cost` and its interference, at most `limit` (JP86). The
    /// caller knows that it is at least `from`.
    #[expect(
        clippy::cast_sign_loss,
        reason = "a quotient of numbers that are not negative"
    )]
    pub(super) fn window(&self, cost: Nanos, from: Nanos, limit: Nanos) -> Option<Nanos> {
        if self.rate >= 1.0 {
            return None;
        }
        // Not rounded up, each term is (w + jitter) / period * cost: a start from below, a little
        // lower for what the floating point rounds.
        let once = (cost + self.constant) as f64 + self.early;
        let least = once / (1.0 - self.rate) * (1.0 - 1e-9);
        let mut window = cost.max(least as Nanos).max(1).max(from);
        // Per term: its delay, and up to which window that holds. Few change from step to step.
        let mut held: Vec<(Nanos, Nanos)> = vec![(0, 0); self.terms.len()];
        let mut sum = cost.saturating_add(self.constant);
        loop {
            for (term, (delay, until)) in self.terms.iter().zip(&mut held) {
                if window > *until {
                    let jobs = window.saturating_add(term.jitter).div_ceil(term.period);
                    let grown = jobs.saturating_mul(term.cost);
                    sum = sum.saturating_add(grown - *delay);
                    *delay = grown;
                    *until = jobs.saturating_mul(term.period).saturating_sub(term.jitter);
                }
            }
            if sum <= window {
                return Some(sum);
            }
            if sum > limit {
                return None;
            }
            window = sum;
        }
    }
}

/// CPU time of a job with everything that comes with it (BTW95): the switch to it and back, again
/// for each time it blocks or may have to wait for a lock.
pub(super) fn job_cost(task: &Task, costs: &Costs) -> Nanos {
    task.demand.map_or(0, |demand| {
        let switches = 2 * (1 + waits(task));
        demand.cost + costs.job + switches * costs.context_switch
    })
}

/// The most times that a reservation is raised in a period: once per chunk of its queue, and one
/// more.
pub(super) fn raises(params: &Params) -> u64 {
    u64::from(params.max_repl()) + 2
}

/// The most times that a job waits, for a suspension or a lock.
fn waits(task: &Task) -> u64 {
    let suspensions = task.demand.map_or(0, |demand| demand.suspensions);
    u64::from(suspensions) + task.sections.len() as u64
}

/// The facts of the locks that need no bound.
pub(super) struct Locks {
    /// Per lock: the priority of its most urgent user.
    ceilings: Vec<u8>,
    /// Per thread: whether each job of it ends before the next one comes.
    settled: Vec<bool>,
}

impl Locks {
    /// The locks of these tasks; no task is settled.
    pub(super) fn of(tasks: &[Task]) -> Self {
        let mut ceilings = Vec::new();
        for task in tasks {
            for section in &task.sections {
                if ceilings.len() <= section.lock {
                    ceilings.resize(section.lock + 1, 0);
                }
                ceilings[section.lock] = task.priority().max(ceilings[section.lock]);
            }
        }
        Self {
            ceilings,
            settled: vec![false; tasks.len()],
        }
    }

    /// Marks reservations that hold locks as settled where `ends` returns true.
    pub(super) fn settle(&mut self, tasks: &[Task], ends: impl Fn(usize, &Self) -> bool) {
        let holders = tasks.iter().enumerate().filter(|(_, task)| {
            !task.sections.is_empty() && matches!(task.scheduling, Scheduling::Reserved(_))
        });
        let settled: Vec<usize> = holders
            .map(|(index, _)| index)
            .filter(|index| ends(*index, self))
            .collect();
        settled
            .into_iter()
            .for_each(|index| self.settled[index] = true);
    }

    fn matters(&self, lock: usize, priority: u8) -> bool {
        self.ceilings.get(lock).is_some_and(|&c| c >= priority)
    }
}

fn relevant_sections<'t>(
    task: &'t Task,
    priority: u8,
    locks: &'t Locks,
    costs: &Costs,
) -> impl Iterator<Item = Nanos> + 't {
    let switches = 2 * costs.context_switch;
    let relevant = task.sections.iter();
    let relevant = relevant.filter(move |s| locks.matters(s.lock, priority));
    relevant.map(move |s| s.length + switches)
}

fn longest_section(task: &Task, priority: u8, locks: &Locks, costs: &Costs) -> Nanos {
    relevant_sections(task, priority, locks, costs)
        .max()
        .unwrap_or(0)
}

/// The delay by less urgent threads that hold locks: under priority inheritance each of them delays
/// with at most one critical section, and each lock is waited for at most once (SRL90).
fn blocking(tasks: &[Task], priority: u8, costs: &Costs, locks: &Locks) -> Nanos {
    let lower = || tasks.iter().filter(|task| task.priority() < priority);
    let by_thread: Nanos = lower()
        .map(|task| longest_section(task, priority, locks, costs))
        .sum();
    if by_thread == 0 {
        return 0;
    }
    let mut longest = vec![0; locks.ceilings.len()];
    for section in lower().flat_map(|task| &task.sections) {
        if locks.matters(section.lock, priority) {
            let length = section.length + 2 * costs.context_switch;
            longest[section.lock] = length.max(longest[section.lock]);
        }
    }
    by_thread.min(longest.iter().sum())
}

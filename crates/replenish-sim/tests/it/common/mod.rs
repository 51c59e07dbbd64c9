//! Random systems for one CPU, each with the input of its analysis.

use replenish_sim::analysis::{Costs, Demand, Section, Task};
use replenish_sim::{
    Enforcement, LockId, Nanos, Platform, Policy, Random, Releases, Span, Step, System, Thread,
};
use sporadic::{Low, Params, Tuning};

/// A system and its description.
pub(crate) struct Case {
    pub(crate) system: System,
    pub(crate) tasks: Vec<Task>,
    pub(crate) costs: Costs,
    pub(crate) horizon: Nanos,
    /// Threads that never stop: (index, time of their only release).
    pub(crate) greedy: Vec<(usize, Nanos)>,
}

/// Draws a system. Small numbers, so that coincidences are frequent.
pub(crate) fn random_case(seed: u64) -> Case {
    let mut random = Random::new(seed);
    let r = &mut random;
    let (platform, costs) = random_platform(r);
    let locks = if one_in(r, 3) {
        r.between(1, 2) as usize
    } else {
        0
    };
    let count = r.between(2, 5);
    let total = r.between(20, 90);
    let mut case = Case {
        system: System {
            cpus: 1,
            locks,
            platform,
            threads: Vec::new(),
        },
        tasks: Vec::new(),
        costs,
        horizon: 0,
        greedy: Vec::new(),
    };
    for index in 0..count {
        let share = total / count;
        case.add_thread(r, index as usize, share);
    }
    // Its one release interrupt would be news to the analysis.
    if locks > 0 && case.costs.release_interrupt == 0 && one_in(r, 2) {
        case.push_background(r);
    }
    let longest = case.tasks.iter().filter_map(|t| t.demand).map(|d| d.period);
    case.horizon = longest.max().unwrap_or(100).max(200) * 8;
    case
}

fn one_in(r: &mut Random, n: u64) -> bool {
    r.up_to(n - 1) == 0
}

fn random_platform(r: &mut Random) -> (Platform, Costs) {
    let mut platform = Platform::IDEAL;
    if one_in(r, 3) {
        platform.context_switch = r.up_to(1);
        platform.job = r.up_to(2);
        platform.release_interrupt = r.up_to(1);
    }
    if one_in(r, 5) {
        platform.tick = Some(r.between(2, 8));
    }
    let mut costs = Costs {
        context_switch: platform.context_switch,
        job: platform.job,
        release_interrupt: platform.release_interrupt,
        tick: platform.tick.unwrap_or(0),
        ..Costs::default()
    };
    if one_in(r, 4) {
        let tuning = Tuning {
            slack: r.up_to(2),
            min_rearm: r.between(1, 3),
            max_backoff: r.between(6, 12),
        };
        let latency = r.up_to(3);
        platform.enforcement = Enforcement::Timer {
            tuning,
            latency: Span::Uniform {
                min: 0,
                max: latency,
            },
            cost: 0,
        };
        costs.latency = latency;
        costs.tuning = tuning;
    }
    (platform, costs)
}

impl Case {
    fn add_thread(&mut self, r: &mut Random, index: usize, share: u64) {
        let priority = r.between(2, 20) as u8;
        let period = r.between(20, 300);
        let amount = (period * share / 100).max(1);
        if r.up_to(1) == 0 {
            let policy = Policy::Fifo { priority };
            let task = Task::fifo(priority, Demand::new(amount, period));
            self.push(r, index, policy, task);
            return;
        }
        let low = if one_in(r, 3) {
            Low::Suspend
        } else if one_in(r, 2) {
            Low::Background(0)
        } else {
            Low::Background(r.between(0, u64::from(priority) - 1) as u8)
        };
        let repl = if one_in(r, 3) { r.between(1, 3) } else { 32 } as u16;
        let params = Params::new(priority, low, amount, period, repl).unwrap();
        let policy = Policy::Sporadic(params);
        let demand = match r.up_to(3) {
            // Fits one budget, or some.
            0 => Demand::new(r.between(1, amount), period + r.up_to(period / 2)),
            1 => {
                let cost = r.between(1, amount * 3);
                Demand::new(cost, (cost.div_ceil(amount) + r.up_to(1)) * period)
            }
            // Many small jobs, or some of any size.
            2 => {
                let cost = r.between(1, amount * 2);
                let least = (cost * period).div_ceil(amount);
                Demand::new(cost, least * r.between(110, 200) / 100 + 1)
            }
            // Its one release interrupt would be news to the analysis.
            _ if self.costs.release_interrupt > 0 => Demand::new(1, period),
            _ => {
                self.push_greedy(r, index, policy, params);
                return;
            }
        };
        self.push(r, index, policy, Task::reserved(params, Some(demand)));
    }

    fn push_greedy(&mut self, r: &mut Random, index: usize, policy: Policy, params: Params) {
        let at = r.up_to(30);
        self.greedy.push((index, at));
        let thread = Thread::new(format!("greedy {index}"), policy)
            .released(Releases::At(vec![at]))
            .runs(1_000_000_000);
        self.system.threads.push(thread);
        self.tasks.push(Task::reserved(params, None));
    }

    /// A thread below all others, busy, and most of the time with a lock.
    fn push_background(&mut self, r: &mut Random) {
        let mut thread =
            Thread::new("background", Policy::Other).released(Releases::At(vec![r.up_to(30)]));
        let mut sections = Vec::new();
        for _ in 0..200 {
            let lock = r.up_to(self.system.locks as u64 - 1) as LockId;
            let length = r.between(1, 20);
            thread = thread.runs(r.up_to(5)).then(Step::Lock(lock));
            thread = thread.runs(length).then(Step::Unlock(lock));
            sections.push(Section { lock, length });
        }
        self.system.threads.push(thread);
        self.tasks.push(Task::background(sections));
    }

    fn push(&mut self, r: &mut Random, index: usize, policy: Policy, mut task: Task) {
        let mut demand = task.demand.unwrap();
        if one_in(r, 3) {
            demand.jitter = r.up_to(demand.period / 3);
        }
        let mut thread = Thread::new(format!("t{index}"), policy).queue(10_000);
        let mut left = demand.cost;
        let run = |r: &mut Random, thread: Thread, part: Nanos| {
            let min = if one_in(r, 2) { part } else { r.up_to(part) };
            thread.runs(Span::Uniform { min, max: part })
        };
        for lock in 0..self.system.locks {
            let length = r.between(1, 6);
            if demand.cost <= length * 4 || one_in(r, 2) {
                continue;
            }
            let before = r.up_to(demand.cost / 5);
            thread = run(r, thread, before).then(Step::Lock(lock as LockId));
            thread = run(r, thread, length).then(Step::Unlock(lock));
            left -= before + length;
            task.sections.push(Section { lock, length });
        }
        if one_in(r, 6) && demand.period > 40 {
            demand.suspensions = 1;
            demand.suspended = r.between(1, demand.period / 5);
            let blocked = Span::Uniform {
                min: r.up_to(demand.suspended),
                max: demand.suspended,
            };
            thread = thread.then(Step::Block(blocked));
        }
        thread = run(r, thread, left);
        let offset = if one_in(r, 2) {
            0
        } else {
            r.up_to(demand.period)
        };
        thread.releases = if demand.jitter == 0 && one_in(r, 3) {
            Releases::Sporadic {
                offset,
                gap: Span::Uniform {
                    min: demand.period,
                    max: demand.period * 3 / 2,
                },
            }
        } else {
            Releases::Periodic {
                offset,
                period: demand.period,
                jitter: demand.jitter,
            }
        };
        task.demand = Some(demand);
        self.tasks.push(task);
        self.system.threads.push(thread);
    }
}

//! Random sets of guarantees: an admitted plan is simulated without a miss, a refusal's suggestion
//! is admitted, the same request gives the same plan, and asking for less never turns a yes into a
//! no.
//!
//! 10 000 sets; `REPLENISH_SETS` sets another number (nightly: 1000000), `REPLENISH_SEED` the first
//! seed.

use replenish_plan::{
    ExecutorRequest, Guarantee, Hold, Machine, Nanos, Overheads, Plan, PlannedWorker, Promise,
    Request, Requirement, Worker, plan,
};
use replenish_sim::analysis::Demand;
use replenish_sim::{Options, Policy, Random, Releases, Span, Step, System, Thread, simulate};
use replenish_testkit::sets;
use sporadic::{Low, Params};
use std::time::Duration;

const US: Nanos = 1_000;
const MS: Nanos = 1_000_000;

fn one_in(r: &mut Random, n: u64) -> bool {
    r.up_to(n - 1) == 0
}

fn random_request(r: &mut Random) -> Request {
    let cpus = r.between(1, 3) as usize;
    let mut machine = Machine::with_cpus(cpus);
    if one_in(r, 3) {
        machine.real_time_share = 1.0;
    }
    if one_in(r, 4) {
        machine.overheads = Overheads::NONE;
    }
    let mut request = Request::new(machine);
    if one_in(r, 2) {
        request.executor = ExecutorRequest::None;
    }
    let count = r.between(1, 4) * cpus as u64;
    let share = r.between(20, 110) * cpus as u64 / count;
    for index in 0..count {
        let worker = random_worker(r, index, share);
        let pinned = one_in(r, 4).then(|| r.up_to(cpus as u64 - 1) as usize);
        request = request.worker(Worker {
            cpu: pinned,
            ..worker
        });
    }
    if one_in(r, 5) {
        request.promised.push(random_promise(r, cpus));
    }
    if one_in(r, 3) {
        add_groups(r, &mut request);
    }
    request
}

/// One or two groups, each on a CPU, with a time-shared worker in half of them.
fn add_groups(r: &mut Random, request: &mut Request) {
    let cpus = request.machine.cpus.len() as u64;
    for lock in 0..r.between(1, 2) as usize {
        request.locks.push(format!("group {lock}"));
        let cpu = r.up_to(cpus - 1) as usize;
        for worker in &mut request.workers {
            let Requirement::Guarantee(guarantee) = &worker.scheduling else {
                continue;
            };
            // A callback is in one group.
            if !one_in(r, 3) || worker.cpu.is_some_and(|c| c != cpu) || !worker.holds.is_empty() {
                continue;
            }
            let length = r.between(1, guarantee.minimum() / 8);
            let unstated = guarantee.is_rate() && one_in(r, 3);
            let length = (!unstated).then_some(length);
            worker.holds.push(Hold::of(lock, length, "its handle"));
        }
        if one_in(r, 2) {
            let name = format!("background {lock}");
            let worker = Worker::with_policy(name, Policy::Other).on(cpu);
            let hold = Hold::of(lock, Some(r.between(1, 3 * MS)), "its handle");
            request.workers.push(worker.holding(hold));
        }
    }
}

fn random_worker(r: &mut Random, index: u64, share: u64) -> Worker {
    let name = format!("w{index}");
    let period = r.between(2, 60) * MS;
    let amount = (period * share / 100).clamp(200 * US, period / 2);
    let span = Duration::from_nanos;
    let mut demand = None;
    let mut guarantee = if one_in(r, 2) {
        Guarantee::of(span(amount)).every(span(period))
    } else {
        let mut known = Demand::new(amount, period);
        if one_in(r, 4) {
            known.jitter = r.up_to(period / 8);
        }
        if one_in(r, 6) {
            known.suspensions = 1;
            known.suspended = r.between(1, period / 10);
        }
        demand = Some(known);
        Guarantee::at(1e9 / period as f64).taking(span(amount))
    };
    if one_in(r, 3) {
        let least = amount.max(guarantee.period() / 2);
        guarantee = guarantee.deadline(span(r.between(least, guarantee.period())));
    }
    if one_in(r, 4) {
        guarantee = guarantee
            .at_least(span(amount / 2))
            .up_to(span(amount + amount / 4));
        if guarantee.check().is_err() {
            guarantee = guarantee.up_to(span(amount));
        }
    }
    guarantee = guarantee.importance(r.up_to(255) as u8);
    if one_in(r, 4) {
        guarantee = guarantee.suspend();
    }
    let worker = Worker::guaranteed(name, guarantee);
    match demand {
        Some(demand) => worker.doing(demand),
        None => worker,
    }
}

fn random_promise(r: &mut Random, cpus: usize) -> Promise {
    let period = r.between(5, 40) * MS;
    let budget = period / r.between(5, 20);
    let priority = r.between(20, 89) as u8;
    let params = Params::new(priority, Low::Background(0), budget, period, 16).unwrap();
    Promise {
        owner: "another program".into(),
        cpu: Some(r.up_to(cpus as u64 - 1) as usize),
        policy: Policy::Sporadic(params),
        demand: None,
        sections: Vec::new(),
        deadline: Some(period),
    }
}

fn held(thread: Thread, lock: usize, length: Nanos) -> Thread {
    let thread = thread.then(Step::Lock(lock)).runs(length);
    thread.then(Step::Unlock(lock))
}

/// Always busy, mostly in its group.
fn background(worker: &Worker, r: &mut Random) -> Thread {
    let mut thread = Thread::new(&*worker.name, Policy::Other).on(worker.cpu);
    thread.releases = Releases::At(vec![r.up_to(MS)]);
    for _ in 0..600 {
        for hold in &worker.holds {
            thread = held(
                thread.runs(r.up_to(200 * US)),
                hold.lock,
                hold.length.unwrap(),
            );
        }
    }
    thread
}

/// The worst that may happen: every thread as busy as the plan allows, released together or not.
fn system(request: &Request, plan: &Plan, r: &mut Random) -> System {
    let overheads = &request.machine.overheads;
    let mut threads = Vec::new();
    for (worker, planned) in request.workers.iter().zip(&plan.workers) {
        let Requirement::Guarantee(guarantee) = &worker.scheduling else {
            threads.push(background(worker, r));
            continue;
        };
        let mut thread = Thread::new(&*worker.name, planned.policy).on(planned.cpu);
        let offset = if one_in(r, 2) {
            0
        } else {
            r.up_to(guarantee.period())
        };
        let amount = planned.amount.unwrap();
        if guarantee.is_rate() {
            let known = worker.demand.unwrap_or(Demand::new(0, 0));
            if known.suspensions > 0 {
                thread = thread.then(Step::Block(Span::Uniform {
                    min: 0,
                    max: known.suspended,
                }));
            }
            let mut left = amount;
            for hold in &worker.holds {
                let length = hold.length.unwrap_or(amount);
                thread = held(thread, hold.lock, length);
                left -= length;
            }
            let min = if one_in(r, 2) { left } else { left / 2 };
            thread = thread.runs(Span::Uniform { min, max: left });
            thread.deadline = Some(guarantee.due_within());
            thread.releases = Releases::Periodic {
                offset,
                period: guarantee.period(),
                jitter: known.jitter,
            };
        } else if one_in(r, 3) {
            // Never enough.
            thread = thread.runs(1_000_000 * MS);
            thread.releases = Releases::At(vec![offset]);
        } else {
            // One callback that fits the budget with all that comes with it, when the budget is
            // certain to be back.
            let extra = overheads.callback
                + overheads.context_switch * 200
                + overheads.latency
                + overheads.tuning.min_rearm
                + overheads.tuning.max_backoff
                + overheads.tuning.for_budget(amount).slack;
            let held_for = worker
                .holds
                .iter()
                .map(|h| h.length.unwrap_or(0))
                .sum::<Nanos>();
            let runs = amount.checked_sub(extra + held_for);
            let Some(runs) = runs.filter(|runs| *runs > 0) else {
                continue;
            };
            for hold in &worker.holds {
                thread = held(thread, hold.lock, hold.length.unwrap_or(0));
            }
            thread = thread.runs(runs);
            // While it waits for a group it asks for no budget.
            thread.deadline = worker.holds.is_empty().then_some(guarantee.due_within());
            thread.releases = Releases::Periodic {
                offset,
                period: guarantee.period() + 2 * overheads.latency,
                jitter: 0,
            };
        }
        threads.push(thread.queue(10));
    }
    for promise in &request.promised {
        let thread = Thread::new("promised", promise.policy)
            .on(promise.cpu)
            .released(Releases::At(vec![0]));
        threads.push(thread.runs(1_000_000 * MS));
    }
    if let Some(executor) = &plan.executor {
        let thread = Thread::new("executor", executor.policy).on(executor.cpu);
        threads.push(thread.released(Releases::At(vec![0])).runs(1_000_000 * MS));
    }
    System {
        cpus: request.machine.cpus.len(),
        locks: request.locks.len(),
        platform: overheads.platform(),
        threads,
    }
}

#[derive(Debug, Default)]
struct Tally {
    admitted: u64,
    refused: u64,
    suggestions: u64,
    jobs: u64,
    close: u64,
    /// Admitted sets with a group that a guaranteed worker shares.
    grouped: u64,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.admitted += other.admitted;
        self.refused += other.refused;
        self.suggestions += other.suggestions;
        self.jobs += other.jobs;
        self.close += other.close;
        self.grouped += other.grouped;
    }
}

fn check(seed: u64, tally: &mut Tally) {
    let r = &mut Random::new(seed);
    let request = random_request(r);
    let found = plan(&request);
    assert_eq!(found, plan(&request), "seed {seed}: two answers");
    match found {
        Ok(admitted) => {
            tally.admitted += 1;
            let waits = |w: &PlannedWorker| w.reasons.iter().any(|r| r.starts_with("group"));
            tally.grouped += u64::from(admitted.workers.iter().any(waits));
            let system = system(&request, &admitted, r);
            let options = Options::until(600 * MS).seed(seed);
            let outcome = simulate(&system, &options).unwrap();
            for (thread, done) in system.threads.iter().zip(&outcome.threads) {
                assert_eq!(
                    done.misses,
                    0,
                    "seed {seed}: {} took {:?}\n{request:#?}\n{admitted:#?}",
                    thread.name,
                    done.worst()
                );
                tally.jobs += done.completed;
                let worst = done.worst().unwrap_or(0);
                tally.close += u64::from(thread.deadline.is_some_and(|d| worst * 2 > d));
            }
            // Beside promises it need not hold: fixed priorities of others can leave so few levels
            // that workers share one, and who shares with whom changes with their number.
            if request.machine.cpus.len() == 1 && request.promised.is_empty() {
                asking_for_less(seed, &request, r);
            }
        }
        Err(refusal) => {
            tally.refused += 1;
            assert!(!refusal.sentence.contains('\n') && refusal.sentence.len() < 400);
            for fit in &refusal.alternatives {
                tally.suggestions += 1;
                if let Err(again) = plan(&fit.apply(&request)) {
                    panic!("seed {seed}: {refusal}\n{fit:?}\n{again}\n{request:#?}");
                }
            }
        }
    }
}

/// On one CPU: without one of the workers, or with less for it, the rest is admitted as well.
fn asking_for_less(seed: u64, request: &Request, r: &mut Random) {
    let index = r.up_to(request.workers.len() as u64 - 1) as usize;
    let mut fewer = request.clone();
    fewer.workers.remove(index);
    if let Err(refusal) = plan(&fewer) {
        panic!("seed {seed}: refused without worker {index}: {refusal}\n{request:#?}");
    }
    let mut less = request.clone();
    let Requirement::Guarantee(guarantee) = &mut less.workers[index].scheduling else {
        return;
    };
    let amount = Duration::from_nanos((guarantee.minimum() / 2).max(1));
    let period = Duration::from_nanos(guarantee.period());
    let deadline = Duration::from_nanos(guarantee.due_within());
    let rate = guarantee.is_rate();
    let smaller = if rate {
        Guarantee::at(1e9 / guarantee.period() as f64).taking(amount)
    } else {
        Guarantee::of(amount).every(period)
    };
    *guarantee = smaller.deadline(deadline);
    if let Err(refusal) = plan(&less) {
        panic!("seed {seed}: less is refused: {refusal}\n{request:#?}");
    }
}

#[test]
fn what_is_admitted_holds_and_what_is_suggested_is_admitted() {
    let sets = sets::wanted(10_000);
    let mut tally = Tally::default();
    for part in sets::each(sets, check) {
        tally.add(&part);
    }
    println!("{sets} sets: {tally:?}");
    // The comparison means something.
    assert!(tally.admitted * 5 > sets && tally.refused * 10 > sets);
    assert!(tally.suggestions > tally.refused && tally.close * 4 > tally.admitted);
    assert!(tally.grouped * 20 > tally.admitted);
}

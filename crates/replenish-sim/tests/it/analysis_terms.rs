//! Terms of the bounds that random systems hardly ever need, each with a run that does: the run
//! stays within the bound, and would not without the term.

use replenish_sim::analysis::{Bounds, Costs, Demand, Section, Task, bounds, describe};
use replenish_sim::{
    Enforcement, Nanos, Options, Platform, Policy, Releases, Span, Step, System, Thread, simulate,
};
use sporadic::{Low, Params, Tuning};

fn reserved(params: Params) -> Policy {
    Policy::Sporadic(params)
}

fn params(priority: u8, budget: Nanos, period: Nanos) -> Params {
    Params::new(priority, Low::Suspend, budget, period, 1).unwrap()
}

fn worst(system: &System, thread: usize, seed: u64) -> Nanos {
    let outcome = simulate(system, &Options::until(20_000).seed(seed)).unwrap();
    outcome.threads[thread].worst().unwrap()
}

fn bounds_of(system: &System) -> Vec<Bounds> {
    let tasks: Vec<_> = describe(system, 0)
        .unwrap()
        .into_iter()
        .map(|t| t.1)
        .collect();
    bounds(&tasks, &Costs::of(&system.platform))
}

fn at(offset: Nanos, period: Nanos) -> Releases {
    Releases::Periodic {
        offset,
        period,
        jitter: 0,
    }
}

#[test]
fn a_lock_held_without_budget_is_waited_for_beyond_the_budget() {
    let system = System {
        locks: 1,
        ..System::on_one_cpu(vec![
            Thread::new("holder", reserved(params(9, 4, 100)))
                .released(at(0, 2_000))
                .then(Step::Lock(0))
                .runs(10)
                .then(Step::Unlock(0)),
            Thread::new("waiter", Policy::Fifo { priority: 5 })
                .released(at(4, 2_000))
                .then(Step::Lock(0))
                .runs(1)
                .then(Step::Unlock(0)),
        ])
    };
    let (took, bound) = (
        worst(&system, 1, 0),
        bounds_of(&system)[1].response.unwrap(),
    );
    assert_eq!(took, 6 + 1);
    assert!(took > 4 + 1, "the budget alone does not explain it");
    assert!(took <= bound);
}

#[test]
fn raises_that_are_now_late_and_now_not_come_closer_than_a_period() {
    let platform = Platform {
        enforcement: Enforcement::Timer {
            tuning: Tuning {
                slack: 0,
                min_rearm: 1,
                max_backoff: 2,
            },
            latency: Span::Samples(vec![0, 8]),
            cost: 0,
        },
        ..Platform::IDEAL
    };
    let system = |offset| System {
        platform: platform.clone(),
        ..System::on_one_cpu(vec![
            Thread::new("above", reserved(params(9, 30, 100)))
                .released(at(0, 1_000))
                .runs(290),
            Thread::new("below", Policy::Fifo { priority: 5 })
                .released(at(offset, 1_000))
                .runs(Span::Constant(58)),
        ])
    };
    let starts = (195..215).flat_map(|offset| (0..20).map(move |seed| (offset, seed)));
    let took = starts
        .map(|(offset, seed)| worst(&system(offset), 1, seed))
        .max()
        .unwrap();
    // 58 + 30 and an overrun of up to 11 is less than the period: one budget, but for the jitter.
    assert!(took > 58 + 30 + 11, "{took}");
    assert!(took <= bounds_of(&system(0))[1].response.unwrap());
}

#[test]
fn each_suspension_gives_the_less_urgent_another_chance_to_hold_the_lock() {
    let section = |thread: Thread, length: Nanos| {
        thread
            .then(Step::Lock(0))
            .runs(length)
            .then(Step::Unlock(0))
    };
    let high = Thread::new("high", Policy::Fifo { priority: 9 }).released(at(1, 1_000));
    let high = section(section(high, 1).then(Step::Block(Span::Constant(20))), 1);
    let low = Thread::new("low", Policy::Fifo { priority: 1 }).released(at(0, 1_000));
    let low = section(section(section(section(low, 8), 8), 8), 8);
    let system = System {
        locks: 1,
        ..System::on_one_cpu(vec![high, low])
    };
    let took = worst(&system, 0, 0);
    assert!(took > 2 + 20 + 8, "{took}");
    assert!(took <= bounds_of(&system)[0].response.unwrap());
}

#[test]
fn below_a_thread_that_misses_its_period_by_suspending_nothing_is_certain() {
    let mut late = Task::fifo(9, Demand::new(10, 100));
    late.demand = Some(Demand {
        suspensions: 1,
        suspended: 95,
        ..Demand::new(10, 100)
    });
    let above = Task::fifo(12, Demand::new(5, 100));
    let below = Task::fifo(5, Demand::new(5, 100));
    let responses: Vec<_> = bounds(&[late, above, below], &Costs::default())
        .iter()
        .map(|bound| bound.response)
        .collect();
    assert_eq!(responses, [None, Some(5), None]);
}

#[test]
fn budget_is_delivered_later_by_what_the_enforcer_is_late() {
    let costs = Costs {
        tick: 3,
        latency: 4,
        ..Costs::default()
    };
    let task = Task::reserved(params(9, 30, 100), Some(Demand::new(5, 300)));
    assert_eq!(bounds(&[task], &costs)[0].service, Some(30 + 3 + 4));
}

#[test]
fn describe_says_what_the_body_does_and_refuses_what_is_not_covered() {
    let thread = Thread::new("t", Policy::Fifo { priority: 5 })
        .released(at(0, 100))
        .runs(Span::Uniform { min: 1, max: 4 })
        .then(Step::Lock(1))
        .then(Step::Lock(0))
        .runs(3)
        .then(Step::Unlock(0))
        .runs(2)
        .then(Step::Unlock(1))
        .then(Step::Block(Span::Constant(7)));
    let system = |thread: Thread| System {
        locks: 2,
        ..System::on_one_cpu(vec![thread])
    };
    let (_, task) = describe(&system(thread.clone()), 0).unwrap().remove(0);
    let demand = task.demand.unwrap();
    assert_eq!((demand.cost, demand.period), (9, 100));
    assert_eq!((demand.suspensions, demand.suspended), (1, 7));
    let section = |lock, length| Section { lock, length };
    assert_eq!(task.sections, [section(0, 3), section(1, 5)]);
    assert_eq!(describe(&system(thread.clone()), 1), Some(vec![]));
    let refused = [
        thread.clone().released(Releases::Never),
        thread
            .clone()
            .then(Step::Lock(0))
            .then(Step::Block(1.into()))
            .then(Step::Unlock(0)),
        Thread {
            policy: Policy::Deadline {
                runtime: 1,
                deadline: 2,
                period: 3,
                reclaim: false,
            },
            ..thread
        },
    ];
    for thread in refused {
        assert_eq!(describe(&system(thread), 0), None);
    }
}

#[test]
fn budget_that_takes_longer_than_its_period_waits_for_what_was_due_before() {
    // (Leh90): the fifth job of a busy period is the latest, 118 after its arrival; the first takes
    // 114.
    let system = System::on_one_cpu(vec![
        Thread::new("above", Policy::Fifo { priority: 9 })
            .released(at(0, 70))
            .runs(26),
        Thread::new("served", reserved(params(8, 62, 100)))
            .released(at(0, 100))
            .runs(62)
            .queue(10),
    ]);
    let bounds = bounds_of(&system)[1];
    assert_eq!(worst(&system, 1, 0), 118);
    assert_eq!(bounds.service, Some(118));
    assert!(bounds.response.is_none_or(|response| response >= 118));
}

#[test]
fn budget_that_comes_back_in_pieces_costs_a_switch_for_each() {
    let platform = Platform {
        context_switch: 1,
        job: 1,
        ..Platform::IDEAL
    };
    let of = |priority, low, budget, period, pieces| {
        Params::new(priority, low, budget, period, pieces).unwrap()
    };
    let background = Low::Background(0);
    let params = of(19, Low::Suspend, 32, 270, 32);
    let late = Releases::Periodic {
        offset: 493,
        period: 1036,
        jitter: 242,
    };
    let system = System {
        platform,
        ..System::on_one_cpu(vec![
            Thread::new("always", reserved(of(11, background, 26, 217, 32)))
                .released(Releases::At(vec![14]))
                .runs(1_000_000),
            Thread::new("now and then", reserved(of(8, background, 31, 259, 2)))
                .released(late)
                .runs(Span::Uniform { min: 30, max: 82 }),
            Thread::new("in pieces", reserved(params))
                .released(at(0, 526))
                .runs(Span::Uniform { min: 50, max: 51 })
                .queue(100),
            Thread::new("below", Policy::Fifo { priority: 8 })
                .released(at(0, 143))
                .runs(17),
        ])
    };
    let took = worst(&system, 2, 40_282_977);
    // The duration if each job needs three rounds at most.
    assert!(took > 628, "{took}");
    // No thread is above it, so the analysis needs no other task.
    let task = Task::reserved(params, Some(Demand::new(51, 526)));
    let bound = bounds(&[task], &Costs::of(&system.platform))[0].response;
    assert!(bound.is_none_or(|bound| took <= bound), "{bound:?}");
}

//! Policies against schedules worked out by hand.

use replenish_sim::{
    End, Enforcement, Nanos, Options, Outcome, Overflow, Platform, Policy, Random, Releases, Span,
    Step, System, Thread, What, simulate,
};
use sporadic::{Level, Low, Params, Tuning};

fn budget(priority: u8, low: Low, budget: Nanos, period: Nanos) -> Policy {
    Policy::Sporadic(Params::new(priority, low, budget, period, 16).unwrap())
}

fn fifo(priority: u8) -> Policy {
    Policy::Fifo { priority }
}

fn once(at: Nanos) -> Releases {
    Releases::At(vec![at])
}

fn run(system: &System, horizon: Nanos) -> Outcome {
    simulate(system, &Options::until(horizon).traced()).unwrap()
}

/// (time, thread) of each dispatch.
fn dispatches(outcome: &Outcome) -> Vec<(Nanos, usize)> {
    let runs = outcome.trace.iter();
    runs.filter(|e| matches!(e.what, What::Run { .. }))
        .map(|e| (e.time, e.thread))
        .collect()
}

#[test]
fn the_more_urgent_preempts_and_the_preempted_keeps_its_place() {
    let system = System::on_one_cpu(vec![
        Thread::new("a", fifo(1)).released(once(0)).runs(10),
        Thread::new("b", fifo(1)).released(once(1)).runs(10),
        Thread::new("c", fifo(2)).released(once(5)).runs(3),
    ]);
    let outcome = run(&system, 100);
    assert_eq!(dispatches(&outcome), [(0, 0), (5, 2), (8, 0), (13, 1)]);
    assert_eq!(outcome.threads[0].responses, [13]);
    assert_eq!(outcome.threads[0].preemptions, 1);
    assert_eq!(outcome.idle, [77]);
}

#[test]
fn an_exhausted_thread_joins_the_tail_of_its_background_priority() {
    let system = |demote_to| System {
        platform: Platform {
            demote_to,
            ..Platform::IDEAL
        },
        ..System::on_one_cpu(vec![
            Thread::new("s", budget(9, Low::Background(1), 4, 20))
                .released(once(0))
                .runs(10),
            Thread::new("peer", fifo(1)).released(once(0)).runs(5),
        ])
    };
    let tail = run(&system(End::Tail), 100);
    assert_eq!(dispatches(&tail), [(0, 0), (4, 1), (9, 0)]);
    assert_eq!(tail.threads[0].cpu_high, 4);
    assert_eq!(tail.threads[0].cpu_low, 6);
    let head = run(&system(End::Head), 100);
    assert_eq!(dispatches(&head), [(0, 0), (10, 1)]);
}

#[test]
fn suspended_without_budget_means_not_at_all() {
    let system = System::on_one_cpu(vec![
        Thread::new("s", budget(9, Low::Suspend, 4, 20))
            .released(once(3))
            .runs(10),
    ]);
    let outcome = run(&system, 100);
    // 4 from 3 on, 4 from 23 on, 2 from 43 on.
    assert_eq!(outcome.threads[0].responses, [42]);
    assert_eq!(outcome.threads[0].exhaustions, 2);
    let levels = outcome.trace.iter().filter_map(|e| match e.what {
        What::Level(level) => Some((e.time, level)),
        _ => None,
    });
    assert_eq!(
        levels.collect::<Vec<_>>().get(..4),
        Some(
            &[
                (7, Level::Low),
                (23, Level::High),
                (27, Level::Low),
                (43, Level::High)
            ][..]
        )
    );
}

#[test]
fn blocking_inside_a_job_starts_a_new_activation_if_it_is_seen() {
    let system = |blocking_seen| System {
        platform: Platform {
            blocking_seen,
            ..Platform::IDEAL
        },
        ..System::on_one_cpu(vec![
            Thread::new("s", budget(9, Low::Suspend, 4, 20))
                .released(once(0))
                .runs(2)
                .then(Step::Block(Span::Constant(10)))
                .runs(4),
        ])
    };
    // 2 from 0 (back at 20), 2 from 12 (back at 32): the last 2 from 20 on.
    assert_eq!(run(&system(true), 100).threads[0].responses, [22]);
    assert_eq!(run(&system(false), 100).threads[0].responses, [22]);
    let again = |seen| {
        let mut system = system(seen);
        system.threads[0].releases = Releases::At(vec![0, 30]);
        run(&system, 100).threads[0].responses[1]
    };
    // Budget at 32 (2 units), 40 (2): runs 32-34, blocks to 44, runs 44-46, then from 52 on.
    assert_eq!(again(true), 24);
    // Unseen, all 4 units count from 0: back at 20, so 2 units are there at 30 already.
    assert_eq!(again(false), 22);
}

#[test]
fn late_enforcement_is_paid_back() {
    let late = Enforcement::Timer {
        tuning: Tuning {
            slack: 0,
            min_rearm: 1,
            max_backoff: 100,
        },
        latency: Span::Constant(7),
        cost: 0,
    };
    let system = System {
        platform: Platform {
            enforcement: late,
            ..Platform::IDEAL
        },
        ..System::on_one_cpu(vec![
            Thread::new("s", budget(9, Low::Background(1), 100, 1000))
                .released(once(0))
                .runs(1_000_000),
            Thread::new("f", fifo(5)).released(once(0)).runs(1_000_000),
        ])
    };
    let outcome = run(&system, 100_000);
    assert_eq!(outcome.threads[0].worst_overrun, 7);
    // 10 % and one overrun, however often it overran.
    assert!((9_900..=10_007).contains(&outcome.threads[0].cpu_high));
}

#[test]
fn a_tick_makes_the_kernel_late_and_the_debt_keeps_the_share() {
    let system = System {
        platform: Platform {
            tick: Some(40),
            ..Platform::IDEAL
        },
        ..System::on_one_cpu(vec![
            Thread::new("s", budget(9, Low::Background(1), 100, 1000))
                .released(once(0))
                .runs(1_000_000),
            Thread::new("f", fifo(5)).released(once(0)).runs(1_000_000),
        ])
    };
    let outcome = run(&system, 100_000);
    assert!(outcome.threads[0].worst_overrun > 0 && outcome.threads[0].worst_overrun < 40);
    assert!((9_800..=10_040).contains(&outcome.threads[0].cpu_high));
}

#[test]
fn deadline_threads_go_before_fifo_by_deadline_and_are_throttled() {
    let dl = |runtime, period| Policy::Deadline {
        runtime,
        deadline: period,
        period,
        reclaim: false,
    };
    let system = System::on_one_cpu(vec![
        Thread::new("long", dl(5, 20)).released(once(0)).runs(8),
        Thread::new("short", dl(2, 10)).released(once(0)).runs(2),
        Thread::new("fifo", fifo(99)).released(once(0)).runs(4),
    ]);
    let outcome = run(&system, 100);
    // short 0-2, long 2-7 throttled to 20, fifo 7-11, long 20-23.
    assert_eq!(dispatches(&outcome), [(0, 1), (2, 0), (7, 2), (20, 0)]);
    assert_eq!(outcome.threads[0].responses, [23]);
    assert_eq!(outcome.threads[0].exhaustions, 1);
}

#[test]
fn unpinned_threads_use_what_cpu_is_free() {
    let system = System {
        cpus: 2,
        ..System::on_one_cpu(vec![
            Thread::new("pinned", fifo(5)).released(once(0)).runs(10),
            Thread::new("free", fifo(9))
                .on(None)
                .released(once(2))
                .runs(4),
            Thread::new("low", fifo(1))
                .on(Some(1))
                .released(once(0))
                .runs(10),
        ])
    };
    let outcome = run(&system, 100);
    assert_eq!(outcome.threads[0].responses, [10]);
    assert_eq!(outcome.threads[1].responses, [4]);
    assert_eq!(outcome.threads[2].responses, [14]);
}

#[test]
fn messages_release_other_threads_and_full_queues_drop() {
    let system = |overflow| {
        let mut worker = Thread::new("worker", fifo(1)).runs(10).queue(1);
        worker.overflow = overflow;
        System::on_one_cpu(vec![
            Thread::new("dispatcher", fifo(9))
                .released(Releases::Bursty {
                    offset: 0,
                    period: 100,
                    burst: 3,
                    spacing: 2,
                })
                .runs(1)
                .then(Step::Send(1)),
            worker,
        ])
    };
    let newest = run(&system(Overflow::DropNewest), 100);
    assert_eq!(newest.threads[1].released, 3);
    assert_eq!(newest.threads[1].dropped, 1);
    // Jobs of 1 and 3; the dispatcher took 2 more meanwhile.
    assert_eq!(newest.threads[1].responses, [12, 20]);
    let oldest = run(&system(Overflow::DropOldest), 100);
    assert_eq!(oldest.threads[1].responses, [12, 18]);
}

#[test]
fn costs_are_paid_by_whom_they_should() {
    let system = System {
        platform: Platform {
            context_switch: 1,
            job: 2,
            release_interrupt: 3,
            ..Platform::IDEAL
        },
        ..System::on_one_cpu(vec![
            Thread::new("low", fifo(1)).released(once(0)).runs(20),
            Thread::new("high", fifo(2)).released(once(10)).runs(5),
        ])
    };
    let outcome = run(&system, 100);
    assert_eq!(outcome.threads[1].responses, [3 + 1 + 2 + 5]);
    assert_eq!(outcome.threads[1].cpu_high, 8);
    assert_eq!(
        outcome.threads[0].responses,
        [3 + (1 + 2 + 20) + (3 + 8) + 1]
    );
    assert_eq!(outcome.overhead, [6]);
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let system = System::on_one_cpu(vec![
        Thread::new("a", budget(9, Low::Background(1), 30, 100))
            .released(Releases::Sporadic {
                offset: 0,
                gap: Span::Uniform { min: 5, max: 90 },
            })
            .runs(Span::Uniform { min: 1, max: 40 }),
        Thread::new("b", fifo(5))
            .released(Releases::Periodic {
                offset: 3,
                period: 70,
                jitter: 20,
            })
            .runs(Span::Samples(vec![3, 9, 27])),
    ]);
    let run = |seed| simulate(&system, &Options::until(50_000).seed(seed).traced()).unwrap();
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).threads, run(6).threads);
}

#[test]
fn several_budgets_hold_whenever_their_threads_start() {
    let mut random = Random::new(2);
    for _ in 0..50 {
        let threads = [(60, 10), (59, 20), (58, 30)].map(|(priority, percent)| {
            Thread::new(
                "t",
                budget(priority, Low::Background(6), percent * 10, 1_000),
            )
            .released(once(random.up_to(3_000)))
            .runs(10_000_000)
        });
        let fifo = Thread::new("fifo", fifo(50))
            .released(once(0))
            .runs(10_000_000);
        let system = System::on_one_cpu(threads.into_iter().chain([fifo]).collect());
        let high = |horizon| {
            let outcome = simulate(&system, &Options::until(horizon)).unwrap();
            [0, 1, 2].map(|id| outcome.threads[id].cpu_high)
        };
        let (before, after) = (high(5_000), high(105_000));
        let got = [0, 1, 2].map(|id| after[id] - before[id]);
        assert_eq!(got, [10_000, 20_000, 30_000]);
    }
}

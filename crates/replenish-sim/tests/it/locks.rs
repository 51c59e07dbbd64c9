//! Priority inheritance, with and without budgets, and systems that cannot go on.

use replenish_sim::{
    Nanos, Options, Outcome, Policy, Releases, SimError, Step, System, Thread, simulate,
};
use sporadic::{Low, Params};

fn once(at: Nanos) -> Releases {
    Releases::At(vec![at])
}

fn fifo(name: &str, priority: u8, at: Nanos) -> Thread {
    Thread::new(name, Policy::Fifo { priority }).released(once(at))
}

fn with_locks(locks: usize, threads: Vec<Thread>) -> System {
    System {
        locks,
        ..System::on_one_cpu(threads)
    }
}

fn run(system: &System) -> Outcome {
    simulate(system, &Options::until(1_000)).unwrap()
}

#[test]
fn inheritance_bounds_the_wait_to_the_critical_section() {
    let system = with_locks(
        1,
        vec![
            fifo("low", 1, 0)
                .then(Step::Lock(0))
                .runs(10)
                .then(Step::Unlock(0))
                .runs(5),
            fifo("middle", 5, 2).runs(100),
            fifo("high", 9, 3)
                .then(Step::Lock(0))
                .runs(1)
                .then(Step::Unlock(0)),
        ],
    );
    let outcome = run(&system);
    // low had the lock for 2 of 10; middle ran 1; then low is boosted for 8 more.
    assert_eq!(outcome.threads[2].responses, [8 + 1]);
    assert_eq!(outcome.threads[1].responses, [1 + 8 + 1 + 99]);
}

#[test]
fn inheritance_goes_along_a_chain_of_locks() {
    let system = with_locks(
        2,
        vec![
            fifo("low", 1, 0)
                .then(Step::Lock(0))
                .runs(10)
                .then(Step::Unlock(0)),
            fifo("mid", 3, 1)
                .then(Step::Lock(1))
                .runs(1)
                .then(Step::Lock(0))
                .runs(2)
                .then(Step::Unlock(0))
                .then(Step::Unlock(1)),
            fifo("noise", 5, 4).runs(100),
            fifo("high", 9, 5)
                .then(Step::Lock(1))
                .runs(1)
                .then(Step::Unlock(1)),
        ],
    );
    // low 0-1, mid 1-2, low 2-4, noise 4-5, then high waits: low 8-(1+2)=7 more, mid 2, high 1.
    assert_eq!(run(&system).threads[3].responses, [7 + 2 + 1]);
}

#[test]
fn a_suspended_holder_runs_while_it_blocks_someone() {
    let params = Params::new(9, Low::Suspend, 4, 100, 8).unwrap();
    let holder = Policy::Sporadic(params);
    let system = with_locks(
        1,
        vec![
            Thread::new("holder", holder)
                .released(once(0))
                .then(Step::Lock(0))
                .runs(10)
                .then(Step::Unlock(0))
                .runs(1),
            fifo("waiter", 5, 6)
                .then(Step::Lock(0))
                .runs(1)
                .then(Step::Unlock(0)),
        ],
    );
    let outcome = run(&system);
    assert_eq!(outcome.threads[1].responses, [6 + 1]);
    assert_eq!(outcome.threads[0].cpu_low, 6, "the boost is not charged");
    assert_eq!(outcome.threads[0].responses, [101]);
}

#[test]
fn a_circle_of_locks_is_reported() {
    let take = |first, second, name: &str, priority, at| {
        fifo(name, priority, at)
            .then(Step::Lock(first))
            .runs(5)
            .then(Step::Lock(second))
            .then(Step::Unlock(second))
            .then(Step::Unlock(first))
    };
    let system = with_locks(2, vec![take(0, 1, "a", 1, 0), take(1, 0, "b", 2, 1)]);
    assert_eq!(
        simulate(&system, &Options::until(100)),
        Err(SimError::Deadlock {
            time: 10,
            thread: "a".into()
        })
    );
}

#[test]
fn threads_that_only_wake_each_other_are_reported() {
    let system = System::on_one_cpu(vec![
        fifo("a", 1, 0).then(Step::Send(1)),
        fifo("b", 1, 0).then(Step::Send(0)),
    ]);
    let error = simulate(&system, &Options::until(100)).unwrap_err();
    assert!(
        matches!(error, SimError::Livelock { time: 0, .. }),
        "{error}"
    );
}

#[test]
fn what_is_wrong_with_a_system_is_named() {
    let message = |thread: Thread| {
        let error = with_locks(1, vec![thread]).check().unwrap_err();
        error.to_string()
    };
    for (thread, part) in [
        (fifo("t", 0, 0), "priority is 0"),
        (fifo("t", 1, 0).on(Some(1)), "cpu 1"),
        (fifo("t", 1, 0).then(Step::Lock(1)), "no"),
        (fifo("t", 1, 0).then(Step::Lock(0)), "held"),
        (fifo("t", 1, 0).then(Step::Unlock(0)), "lacks"),
        (fifo("t", 1, 0).then(Step::Send(1)), "thread 1"),
        (
            fifo("t", 1, 0).released(Releases::periodic(0)),
            "period is 0",
        ),
        (
            fifo("t", 1, 0).released(Releases::At(vec![2, 1])),
            "ascending",
        ),
    ] {
        let text = message(thread);
        assert!(
            text.starts_with("thread \"t\"") && text.contains(part),
            "{text}"
        );
    }
}

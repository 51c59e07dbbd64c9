//! The theorem of `docs/servers.md` over whole traces in virtual time, for the corrected server and
//! the whole reservation:
//! - (a) never more than B and the stated latency in a window of length T, or 2 B after being kept
//!   from the CPU, or B again where nobody records blocking, or where the window begins without
//!   budget waiting,
//! - (b) a thread that always wants more gets B in every T, but for one budget in all,
//! - (c) CPU time is conserved to the nanosecond,
//! - (d) a supervised thread that runs always has a check.

use crate::common::world::{
    Knowledge, Setup, Step, TUNING, World, budget_and_period, setups, steps,
};
use proptest::prelude::*;
use sporadic::Nanos;

/// `REPLENISH_TRACES` says how many; a few of each in CI.
fn config() -> ProptestConfig {
    let cases = std::env::var("REPLENISH_TRACES").ok();
    ProptestConfig {
        cases: cases.map_or(3_000, |n| n.parse().unwrap()),
        failure_persistence: None,
        max_shrink_iters: 2_000,
        ..ProptestConfig::default()
    }
}

fn trace(preempted: bool) -> impl Strategy<Value = (Setup, Vec<Step>)> {
    setups().prop_flat_map(move |setup| {
        let steps = steps(&setup, preempted, 120);
        (Just(setup), steps)
    })
}

proptest! {
    #![proptest_config(config())]

    /// On b209253: a thread without records exceeded the bound in three of four traces.
    #[test]
    fn a_thread_that_is_never_kept_waiting((setup, steps) in trace(false)) {
        let mut world = World::new(setup);
        steps.into_iter().for_each(|step| world.step(step));
        world.check_account();
        world.check_windows(0);
    }

    /// On b209253 budgets came back to back without end after starvation.
    #[test]
    fn a_thread_that_is_preempted((setup, steps) in trace(true)) {
        let mut world = World::new(setup);
        steps.into_iter().for_each(|step| world.step(step));
        world.check_account();
        world.check_windows(u64::from(world.setup.knowledge != Knowledge::Nothing));
    }

    /// However long it was kept from the CPU: a window that begins without budget waiting has one
    /// budget for each of its periods.
    #[test]
    fn a_window_that_begins_without_budget_waiting((setup, steps) in trace(true)) {
        let mut world = World::new(Setup { refusals: Vec::new(), ..setup });
        steps.into_iter().for_each(|step| world.step(step));
        world.check_windows_without_budget_waiting();
    }

    /// A thread that never waits is short of one budget at most, however long it runs: checks come
    /// early and late, and of what is left too little for a timer nothing is lost.
    ///
    /// On b209253 it lost a sliver in each period.
    #[test]
    fn a_hungry_thread(
        (budget, period) in budget_and_period(),
        max_repl in 1..=16u16,
        latencies in prop::collection::vec(-10_000..30_000i64, 1..12),
        change_takes in 0..5_000u64,
        knowledge in prop_oneof![
            Just(Knowledge::Records), Just(Knowledge::Overflow(0)), Just(Knowledge::Counter),
        ],
        periods in 1..400u64,
    ) {
        let budget = budget.max(50_000);
        let mut setup = Setup {
            budget, period, max_repl, tuning: TUNING, knowledge, latencies, change_takes,
            refusals: Vec::new(),
        };
        setup.period = period.max(budget + setup.stated());
        let short = short_of(setup, periods);
        prop_assert!(short <= budget, "short of {short} after {periods} periods");
    }
}

/// The time that a thread that always runs gets less than B in every T.
fn short_of(setup: Setup, periods: u64) -> Nanos {
    let (budget, period) = (setup.budget, setup.period);
    let mut world = World::new(setup);
    world.step(Step::Run(periods * period));
    (periods * budget).saturating_sub(world.r.counters().cpu_high)
}

/// The deviations measured on b209253, −1.3 and −3.7 %, with the usual latencies of Linux.
#[test]
fn the_long_run_share_of_small_budgets() {
    for (budget, period) in [
        (50_000, 500_000),
        (100_000, 1_000_000),
        (800_000, 3_000_000),
        (2_500_000, 11_000_000),
        (23_000_000, 70_000_000),
    ] {
        let setup = Setup {
            budget,
            period,
            max_repl: 16,
            tuning: TUNING,
            knowledge: Knowledge::Records,
            latencies: vec![-900, -1_100, 5_000, -9_900, -1_000, 14_000, -800],
            change_takes: 1_000,
            refusals: Vec::new(),
        };
        let periods = 10_000;
        let short = short_of(setup, periods);
        let share = short as f64 / (periods * budget) as f64;
        assert!(
            share < 0.000_5,
            "{budget} in {period}: {:.2} % short",
            100.0 * share
        );
    }
}

/// An advance payment is made once, however often the account is read.
#[test]
fn reading_the_account_gives_nothing_away() {
    let (budget, period) = (1_000_000, 10_000_000);
    let setup = Setup {
        budget,
        period,
        max_repl: 16,
        tuning: TUNING,
        knowledge: Knowledge::Records,
        latencies: vec![-5_000],
        change_takes: 0,
        refusals: Vec::new(),
    };
    let mut world = World::new(setup);
    let rounds = 20;
    for _ in 0..rounds * period / 20_000 {
        world.step(Step::Run(20_000));
        world.step(Step::Observe);
    }
    let high = world.r.counters().cpu_high;
    assert!(high <= rounds * budget + TUNING.slack, "{high}");
}

/// Without records a thread is short of the time that it was not on its CPU, and of no more.
#[test]
fn the_share_without_records() {
    let setup = Setup {
        budget: 10_000_000,
        period: 100_000_000,
        max_repl: 16,
        tuning: TUNING,
        knowledge: Knowledge::Nothing,
        latencies: vec![4_000],
        change_takes: 1_000,
        refusals: Vec::new(),
    };
    let periods = 10_000;
    let short = short_of(setup, periods);
    let share = short as f64 / (periods * 10_000_000) as f64;
    assert!(share < 0.000_5, "{:.3} % short", 100.0 * share);
}

/// Six budgets in one piece on b209253: a callback that sleeps, and then computes.
#[test]
fn budget_does_not_pile_up_while_nobody_sees_it_block() {
    for knowledge in [
        Knowledge::Nothing,
        Knowledge::Counter,
        Knowledge::Overflow(0),
    ] {
        let setup = Setup {
            budget: 10_000_000,
            period: 100_000_000,
            max_repl: 16,
            tuning: TUNING,
            knowledge,
            latencies: vec![5_000],
            change_takes: 1_000,
            refusals: Vec::new(),
        };
        let mut world = World::new(setup);
        world.step(Step::Run(1_000_000));
        world.step(Step::Inside(600_000_000));
        world.step(Step::Run(300_000_000));
        world.check_windows(0);
    }
}

/// 110 ms of 300 on b209253, for 10 ms in every 100.
#[test]
fn after_starvation_two_budgets_come_back_to_back() {
    let setup = Setup {
        budget: 10_000_000,
        period: 100_000_000,
        max_repl: 16,
        tuning: TUNING,
        knowledge: Knowledge::Records,
        latencies: vec![5_000],
        change_takes: 0,
        refusals: Vec::new(),
    };
    let mut world = World::new(setup);
    world.step(Step::Preempted(1_000_000_000));
    world.step(Step::Run(300_000_000));
    world.check_windows(1);
    let high = world.r.counters().cpu_high;
    assert!(high <= 40_000_000 + world.setup.stated(), "{high}");
}

/// A small budget that blocks inside its callback: 519 us too much of 200 on b209253.
#[test]
fn a_small_budget_that_blocks_overruns_by_a_quarter() {
    let setup = Setup {
        budget: 200_000,
        period: 10_000_000,
        max_repl: 16,
        tuning: TUNING,
        knowledge: Knowledge::Records,
        latencies: vec![0],
        change_takes: 0,
        refusals: Vec::new(),
    };
    let mut world = World::new(setup);
    world.step(Step::Run(190_000 - TUNING.slack));
    world.step(Step::Inside(4_321_000));
    world.step(Step::Run(2_000_000));
    let high = world.r.counters().cpu_high;
    assert!(high <= 250_000, "{high} of 200 us");
}

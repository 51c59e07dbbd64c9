//! A supervised thread in virtual time: the enforcer comes late, preemption and blocking happen
//! unseen, and still no CPU time escapes the account and no check comes later than promised.

use proptest::prelude::*;
use sporadic::{
    BlockedInterval, BudgetServer, Corrected, Level, Low, Nanos, Params, Readings, Reservation,
    Tuning, Verdict,
};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
const TUNING: Tuning = Tuning::LINUX;
const NOT_BLOCKED: Readings<'static> = Readings::Exact(&[]);

/// A thread, its CPU clock and its supervisor in virtual time.
struct Sim {
    now: Nanos,
    cpu: Nanos,
    r: Reservation<Corrected<128>>,
    latencies: Vec<Nanos>,
    turn: usize,
    checks: u64,
    change_takes: Nanos,
    overruns: Vec<i64>,
}

impl Sim {
    fn new(budget: Nanos, period: Nanos, latencies: Vec<Nanos>) -> Self {
        let params = Params::new(60, Low::Background(6), budget, period, 128).unwrap();
        let server = Corrected::new(params, 0)
            .unwrap()
            .with_min_chunk(TUNING.slack);
        let r = Reservation::new(server, TUNING, 0, 0);
        Self {
            now: 0,
            cpu: 0,
            r,
            latencies,
            turn: 0,
            checks: 0,
            change_takes: 0,
            overruns: Vec::new(),
        }
    }

    /// Carrying a verdict out takes a moment, in which the thread does not run.
    fn obey(&mut self, verdict: Verdict) {
        if let Some(level) = verdict.change {
            self.now += self.change_takes;
            self.overruns
                .extend(self.r.applied(level, self.now, self.cpu));
        }
    }

    fn activate(&mut self) {
        self.r.activate(self.now, self.now, self.cpu);
    }

    fn block(&mut self) {
        self.r.block(self.now, self.cpu, NOT_BLOCKED);
    }

    /// Lets `span` pass; the thread consumes all of it or nothing. Checks come when they are due,
    /// late by the next latency, as long as the thread exists.
    fn pass(&mut self, span: Nanos, on_cpu: bool) {
        let end = self.now + span;
        while let Some(at) = self.r.check_at() {
            let latency = self.latencies[self.turn % self.latencies.len()];
            let fires = at.max(self.now).saturating_add(latency);
            if fires > end {
                break;
            }
            self.turn += 1;
            self.advance(fires - self.now, on_cpu);
            self.checks += 1;
            let v = self.r.judge(self.now, self.cpu, NOT_BLOCKED);
            self.obey(v);
        }
        self.advance(end.saturating_sub(self.now), on_cpu);
    }

    fn advance(&mut self, span: Nanos, on_cpu: bool) {
        self.now += span;
        if on_cpu {
            self.cpu += span;
        }
    }
}

#[test]
fn a_spinner_gets_its_budget_in_every_period_and_pays_overruns_back() {
    let mut sim = Sim::new(30 * MS, 100 * MS, vec![0, 3 * US, 40 * US, 4 * MS, 12 * US]);
    sim.activate();
    for period in 1..=200_u64 {
        sim.pass(100 * MS, true);
        let high = sim.r.counters().cpu_high;
        let due = period * 30 * MS;
        // Late promotions delay, they never lose: at most one overrun or one lateness apart.
        assert!(
            high.abs_diff(due) <= 4 * MS + 50 * US,
            "{period}: {high} of {due}"
        );
    }
    let c = *sim.r.counters();
    assert_eq!(c.cpu_high + c.cpu_low, sim.r.last_reading().0);
    assert!(c.exhaustions >= 199);
    // One check at the end of the budget, one at the replenishment, and little more.
    assert!(sim.checks <= 4 * 200, "{} checks", sim.checks);
}

#[test]
fn a_thread_that_waits_without_budget_is_raised_before_it_wakes() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![5 * US]);
    sim.activate();
    sim.pass(20 * MS, true);
    assert_eq!(sim.r.level(), Level::Low);
    sim.block();
    sim.pass(100 * MS, false);
    assert_eq!(
        sim.r.level(),
        Level::High,
        "a lowered thread could not raise itself later"
    );
    assert_eq!(
        sim.r.check_at(),
        None,
        "and then there is nothing left to check"
    );
}

#[test]
fn callbacks_within_their_budget_leave_the_timer_alone() {
    let mut sim = Sim::new(30 * MS, 100 * MS, vec![5 * US]);
    for _ in 0..4000 {
        sim.activate();
        sim.pass(50 * US, true);
        sim.block();
        sim.pass(950 * US, false);
    }
    assert_eq!(sim.r.counters().exhaustions, 0);
    // 4 s of work at 5 %: about one check per 30 ms, not one per callback.
    assert!(
        sim.checks <= 200,
        "{} checks for 4000 callbacks",
        sim.checks
    );
}

#[test]
fn a_preempted_thread_with_a_sliver_left_causes_no_storm() {
    let mut sim = Sim::new(30 * MS, 100 * MS, vec![2 * US]);
    sim.activate();
    sim.pass(30 * MS - 40 * US, true);
    let before = sim.checks;
    sim.pass(50 * MS, false);
    let storm = sim.checks - before;
    assert!(storm <= 6 + 50, "{storm} checks in 50 ms without progress");
    // Another thread left the CPU: the server is judged at the exact time again, so the distance
    // causes no overrun.
    assert!(sim.r.is_backed_off());
    assert!(sim.r.pull_in(sim.now));
    sim.pass(100 * US, true);
    assert_eq!(sim.r.level(), Level::Low);
    assert!(
        sim.overruns[0] <= i64::try_from(10 * US).unwrap(),
        "{:?}",
        sim.overruns
    );
}

#[test]
fn pulling_a_check_in_never_moves_it_away() {
    // Hardly any progress up to the first check. Then the thread runs unseen, and another thread
    // leaves the CPU: how much it has consumed since the reading is not known.
    let mut sim = Sim::new(53 * MS, 253 * MS, vec![0]);
    sim.activate();
    sim.pass(5 * MS, true);
    sim.pass(48 * MS, false);
    assert!(sim.r.is_backed_off());
    let check = sim.r.check_at();
    sim.pass(27 * MS, true);
    assert!(!sim.r.pull_in(sim.now));
    assert_eq!(sim.r.check_at(), check);
    sim.pass(100 * MS, true);
    assert_eq!(sim.r.level(), Level::Low);
    assert_eq!(sim.overruns, [0]);
}

/// With a full queue, a reading puts budget off that was due. The check that was set for that
/// budget would come too late.
#[test]
fn a_reading_can_bring_the_check_nearer() {
    let params = Params::new(60, Low::Background(6), 10 * MS, 20 * MS, 1).unwrap();
    let server = Corrected::<1>::new(params, 0).unwrap();
    let mut r = Reservation::new(server, TUNING, 0, 0);
    r.activate(0, 0, 0);
    r.block(4 * MS, 4 * MS, NOT_BLOCKED);
    r.activate(5 * MS, 5 * MS, 4 * MS);
    let verdict = r.judge(21 * MS, 4 * MS, NOT_BLOCKED); // preempted until now, and all is due
    assert_eq!((verdict.change, r.check_at()), (None, Some(31 * MS)));
    r.observe(23 * MS, 5 * MS, NOT_BLOCKED);
    let chunks: Vec<_> = r.server().chunks().map(|c| (c.time, c.amount)).collect();
    assert_eq!(chunks, [(5 * MS, 5 * MS), (25 * MS, 5 * MS)]);
    assert_eq!(r.check_at(), Some(28 * MS));
}

#[test]
fn blocking_inside_a_callback_starts_a_new_activation() {
    // 5 ms, a sleep of 50 ms inside the callback, 5 ms: what was used after the sleep comes back
    // a period after the sleep, not a period after the first activation.
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.activate();
    sim.now = 60 * MS;
    sim.cpu = 10 * MS;
    let interval = BlockedInterval {
        ran: 5 * MS,
        out_at: 5 * MS,
        in_at: 55 * MS,
    };
    let v = sim.r.judge(sim.now, sim.cpu, Readings::Exact(&[interval]));
    sim.obey(v);
    assert_eq!(sim.r.level(), Level::Low);
    let back: Vec<_> = sim
        .r
        .server()
        .chunks()
        .map(|c| (c.time, c.amount))
        .collect();
    assert_eq!(back, [(100 * MS, 5 * MS), (155 * MS, 5 * MS)]);
}

#[test]
fn waiting_for_the_cpu_does_not_delay_the_replenishment() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.pass(20 * MS, false);
    // Woken at 5 ms, kept off the CPU until 20 ms; an observer reads the account meanwhile.
    sim.r.observe(sim.now, sim.cpu, NOT_BLOCKED);
    sim.r.activate(5 * MS, sim.now, sim.cpu);
    sim.pass(30 * MS, true);
    assert_eq!(sim.r.level(), Level::Low);
    assert_eq!(sim.r.check_at(), Some(105 * MS));
}

/// A worker that waited at its high level had the way from its last account to its sleep, and from
/// its next wake-up to the check, at its high priority: torture, seed 149, 240 us.
#[test]
fn a_thread_that_waits_without_budget_waits_at_the_low_level() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.activate();
    sim.advance(10 * MS, true);
    sim.block();
    assert_eq!(
        (sim.r.level(), sim.r.check_at()),
        (Level::High, Some(10 * MS))
    );
    sim.pass(1, false);
    let lowered = (Level::Low, Some(100 * MS));
    assert_eq!((sim.r.level(), sim.r.check_at()), lowered);
    // Woken before the budget is back: it runs at the low level from the start.
    sim.pass(70 * MS, false);
    sim.activate();
    assert_eq!((sim.r.level(), sim.r.check_at()), lowered);
    sim.block();
    sim.pass(20 * MS, false);
    assert_eq!(sim.r.level(), Level::High);
    let counters = sim.r.counters();
    assert_eq!((counters.exhaustions, counters.replenishments), (0, 1));
}

#[test]
fn a_thread_that_waits_with_budget_is_left_alone() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.activate();
    sim.advance(9 * MS, true);
    sim.block();
    sim.pass(95 * MS, false);
    let counters = sim.r.counters();
    assert_eq!((sim.r.level(), sim.r.check_at()), (Level::High, None));
    assert_eq!((counters.replenishments, counters.early_checks), (0, 0));
}

/// A lowering that the system refuses is not tried again while the thread waits, and at once when
/// it goes on without budget.
#[test]
fn a_refused_lowering_waits_with_the_thread() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.activate();
    sim.advance(10 * MS, true);
    sim.block();
    let verdict = sim.r.judge(sim.now, sim.cpu, NOT_BLOCKED);
    assert_eq!(verdict.change, Some(Level::Low));
    sim.r.refused(sim.now);
    sim.pass(50 * MS, false);
    assert_eq!((sim.r.level(), sim.r.check_at()), (Level::High, None));
    sim.activate();
    assert_eq!(sim.r.check_at(), Some(sim.now));
}

#[test]
fn time_that_the_enforcer_itself_took_moves_the_check() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.r.postpone(50 * US);
    assert_eq!(
        sim.r.check_at(),
        None,
        "nothing to move for a thread that waits"
    );
    sim.activate();
    assert_eq!(sim.r.check_at(), Some(10 * MS));
    sim.r.postpone(50 * US);
    assert_eq!(sim.r.check_at(), Some(10 * MS + 50 * US));
    sim.pass(20 * MS, true);
    assert_eq!(
        (sim.r.level(), sim.r.check_at()),
        (Level::Low, Some(100 * MS))
    );
    sim.r.postpone(50 * US);
    assert_eq!(
        sim.r.check_at(),
        Some(100 * MS),
        "a replenishment is due when it is due"
    );
}

/// The replenishment comes due while the enforcer is busy lowering the thread.
#[test]
fn a_replenishment_during_the_change_of_level_is_not_missed() {
    let mut sim = Sim::new(10 * MS, 100 * MS, vec![0]);
    sim.activate();
    sim.advance(10 * MS, true);
    let verdict = sim.r.judge(sim.now, sim.cpu, NOT_BLOCKED);
    assert_eq!(verdict.change, Some(Level::Low));
    sim.now = 100 * MS;
    sim.obey(verdict);
    assert_eq!(sim.r.level(), Level::Low);
    assert!(
        sim.r.check_at().is_some_and(|at| at <= sim.now),
        "nobody would raise it again"
    );
    sim.pass(1, false);
    assert_eq!(sim.r.level(), Level::High);
}

#[derive(Clone, Debug)]
enum Step {
    Run(Nanos),
    Preempted(Nanos),
    Wait(Nanos),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let span = 1..20 * MS;
    prop::collection::vec(
        prop_oneof![
            4 => span.clone().prop_map(Step::Run),
            1 => span.prop_map(Step::Preempted),
            1 => (1..60 * MS).prop_map(Step::Wait),
        ],
        1..200,
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn cpu_time_is_conserved_and_no_check_is_late(
        budget in 50 * US..50 * MS,
        steps in steps(),
        latencies in prop::collection::vec(0..60 * US, 1..8),
        change_takes in 0..40 * US,
    ) {
        let worst = latencies.iter().copied().max().unwrap();
        let mut sim = Sim::new(budget, 50 * MS, latencies);
        sim.change_takes = change_takes;
        sim.activate();
        for step in steps {
            match step {
                Step::Run(t) => sim.pass(t, true),
                Step::Preempted(t) => sim.pass(t, false),
                Step::Wait(t) => {
                    sim.block();
                    sim.pass(t, false);
                    sim.activate();
                }
            }
            let c = sim.r.counters();
            prop_assert_eq!(c.cpu_high + c.cpu_low, sim.r.last_reading().0);
            let sum: Nanos = sim.r.server().chunks().map(|c| c.amount).sum();
            prop_assert_eq!(sum, budget);
            let supervised = sim.r.level() == Level::Low || sim.r.is_runnable();
            prop_assert!(!supervised || sim.r.check_at().is_some(), "forgotten: {:?}", sim.r);
        }
        let bound = i64::try_from(worst + TUNING.max_backoff + TUNING.min_rearm).unwrap();
        for overrun in &sim.overruns {
            prop_assert!(*overrun <= bound, "overrun {} ns", overrun);
            prop_assert!(*overrun >= -i64::try_from(TUNING.slack).unwrap(), "{} ns", overrun);
        }
        // The long run: never more than the budget of every period begun, and one overrun.
        let periods = sim.now / (50 * MS) + 1;
        let limit = periods * budget + worst + TUNING.max_backoff + TUNING.min_rearm;
        prop_assert!(sim.r.counters().cpu_high <= limit);
    }
}

/// A little more than the slack is left whenever the enforcer is on its way while a thread runs: a
/// check for 15 us of 5 ms took two more wake-ups, a seventh of all with 16 workers.
#[test]
fn a_large_budget_has_more_slack_and_a_small_one_keeps_its_precision() {
    let of = |budget| TUNING.for_budget(budget).slack;
    assert_eq!(
        (of(50 * US), of(2 * MS), of(3 * MS)),
        (10 * US, 10 * US, 15 * US)
    );
    assert_eq!((of(5 * MS), of(100 * MS)), (25 * US, 25 * US));
    assert_eq!(TUNING.for_budget(MS).min_rearm, TUNING.min_rearm);
    let params = Params::new(60, Low::Background(6), 5 * MS, 100 * MS, 16).unwrap();
    let server = Corrected::<16>::new(params, 0).unwrap();
    let mut r = Reservation::new(server, TUNING.for_budget(params.budget()), 0, 0);
    r.activate(0, 0, 0);
    let left = 15 * US;
    let verdict = r.judge(5 * MS, 5 * MS - left, NOT_BLOCKED);
    assert_eq!(verdict.change, Some(Level::Low));
    assert_eq!(r.applied(Level::Low, 5 * MS, 5 * MS - left), Some(-15_000));
    // It is not lost: the next round is longer by as much.
    let verdict = r.judge(100 * MS, 5 * MS - left, NOT_BLOCKED);
    assert_eq!(verdict.change, Some(Level::High));
    let _ = r.applied(Level::High, 100 * MS, 5 * MS - left);
    let (_, cpu) = (r.last_reading(), r.limit().unwrap());
    assert_eq!(cpu, 10 * MS);
}

/// Refusals are tried again after a bounded time. A thread that cannot be lowered uses more than
/// its budget: it was tried again an eighth of a period later, 1.25 s with a period of 10 s.
#[test]
fn a_refused_change_is_tried_again_soon_if_the_thread_takes_too_much() {
    for (period, low) in [(MS, MS), (80 * MS, 40 * MS), (10_000 * MS, 100 * MS)] {
        for (budget, high) in [(MS / 10, MS / 20), (MS / 2, MS / 8)] {
            let params = Params::new(60, Low::Background(6), budget, period, 16).unwrap();
            let server = Corrected::<16>::new(params, 0).unwrap();
            let mut r = Reservation::new(server, TUNING, 0, 0);
            r.activate(0, 0, 0);
            r.refused(7);
            assert_eq!(r.check_at(), Some(7 + high));
            let verdict = r.judge(budget, budget, NOT_BLOCKED);
            assert_eq!(verdict.change, Some(Level::Low));
            let _ = r.applied(Level::Low, budget, budget);
            r.refused(budget);
            assert_eq!(r.check_at(), Some(budget + low));
        }
    }
}

/// Without `CAP_SYS_NICE`, a worker that woke 4000 times a second asked as often for its raise:
/// the enforcer took 6 % of a CPU, at priority 99.
#[test]
fn a_refused_change_is_not_asked_for_at_each_activation() {
    let params = Params::new(60, Low::Background(6), 5 * MS, 50 * MS, 16).unwrap();
    let server = Corrected::<16>::new(params, 0).unwrap();
    let mut r = Reservation::new(server, TUNING, 0, 0);
    r.activate(0, 0, 0);
    let verdict = r.judge(5 * MS, 5 * MS, NOT_BLOCKED);
    assert_eq!(verdict.change, Some(Level::Low));
    let _ = r.applied(Level::Low, 5 * MS, 5 * MS);
    let (mut asked, mut now, mut cpu) = (0, 5 * MS, 5 * MS);
    while now < 1_005 * MS {
        now += MS / 4;
        cpu += MS / 8;
        r.block(now, cpu, NOT_BLOCKED);
        r.activate(now, now, cpu);
        r.observe(now, cpu, NOT_BLOCKED);
        let due = r.check_at().expect("a check, whatever happens");
        if due <= now && r.judge(now, cpu, NOT_BLOCKED).change.is_some() {
            asked += 1;
            r.refused(now);
        }
    }
    // Each half of a period, once it is funded again.
    assert!((30..=40).contains(&asked), "{asked}");
    // The kernel obeys again.
    let due = r.check_at().unwrap();
    assert_eq!(r.judge(due, cpu, NOT_BLOCKED).change, Some(Level::High));
    let _ = r.applied(Level::High, due, cpu);
    // A reading whose check is due now is no longer kept back by the refusal.
    r.observe(due + 6 * MS, cpu + 6 * MS, NOT_BLOCKED);
    assert_eq!(r.check_at(), Some(due + 6 * MS));
}

/// A server that writes down when its thread became runnable, with its budget always there.
struct Spy(Params, Vec<Nanos>);

impl BudgetServer for Spy {
    fn params(&self) -> &Params {
        &self.0
    }
    fn activate(&mut self, now: Nanos) {
        self.1.push(now);
    }
    fn block(&mut self, _: Nanos) {}
    fn charge(&mut self, _: Nanos, _: Nanos) {}
    fn update(&mut self, _: Nanos) -> Level {
        Level::High
    }
    fn available(&self, _: Nanos) -> Nanos {
        self.0.budget()
    }
    fn next_replenishment(&self) -> Option<Nanos> {
        None
    }
    fn pending(&self) -> usize {
        0
    }
}

fn spied() -> Reservation<Spy> {
    let params = Params::new(60, Low::Background(6), 10 * MS, 100 * MS, 4).unwrap();
    Reservation::new(Spy(params, Vec::new()), TUNING, 0, 0)
}

#[test]
fn a_wake_up_lies_between_the_last_reading_and_now() {
    let mut r = spied();
    r.activate(0, 0, 0);
    r.block(10 * MS, 2 * MS, NOT_BLOCKED);
    r.activate(3 * MS, 20 * MS, 2 * MS); // before the wait began
    r.block(30 * MS, 3 * MS, NOT_BLOCKED);
    r.activate(35 * MS, 40 * MS, 3 * MS);
    r.block(50 * MS, 4 * MS, NOT_BLOCKED);
    r.activate(70 * MS, 60 * MS, 4 * MS); // after now
    assert_eq!(r.server().1, [0, 10 * MS, 35 * MS, 60 * MS]);
}

#[test]
fn less_than_an_eighth_of_the_time_is_no_progress() {
    for (used, idle) in [(MS - 1, 1), (MS, 0), (2 * MS, 0), (0, 1)] {
        let mut r = spied();
        r.activate(0, 0, 0);
        let verdict = r.judge(8 * MS, used, NOT_BLOCKED);
        assert_eq!(verdict.change, None);
        assert_eq!(r.counters().idle_checks, idle, "{used}");
        assert_eq!(r.is_backed_off(), idle == 1, "{used}");
        assert_eq!(r.counters().early_checks, 1);
    }
    // A thread that waits makes no progress and is not checked for it.
    let mut r = spied();
    assert_eq!(r.judge(8 * MS, 0, NOT_BLOCKED).change, None);
    assert_eq!((r.counters().idle_checks, r.check_at()), (0, None));
}

#[test]
fn checks_without_progress_double_up_to_a_quarter_of_the_budget() {
    let mut r = spied();
    r.activate(0, 0, 0);
    let longest = TUNING.backoff(10 * MS);
    assert_eq!(longest, MS, "max_backoff");
    assert_eq!((TUNING.backoff(MS), TUNING.backoff(1)), (MS / 4, 50 * US));
    let mut now = 0;
    for _ in 0..12 {
        now += 10 * MS;
        assert_eq!(r.judge(now, 0, NOT_BLOCKED).change, None);
        // The budget is whole: the check for its end is farther away than any back-off.
        assert_eq!(r.check_at(), Some(now + 10 * MS));
    }
    assert_eq!(r.counters().idle_checks, 12);
    assert!(r.is_backed_off());
    // Progress ends it.
    assert_eq!(r.judge(now + MS, MS, NOT_BLOCKED).change, None);
    assert!(!r.is_backed_off());
}

#[test]
fn a_limit_of_cpu_time_is_no_nearer_than_a_check() {
    let of = |budget| {
        let params = Params::new(60, Low::Background(6), budget, 100 * MS, 4).unwrap();
        let mut r = Reservation::new(Spy(params, Vec::new()), TUNING, 0, 0);
        assert_eq!(r.limit(), None, "it waits");
        r.activate(0, 0, 7);
        r.limit()
    };
    assert_eq!(of(1), Some(7 + TUNING.min_rearm));
    assert_eq!(of(MS), Some(7 + MS));
}

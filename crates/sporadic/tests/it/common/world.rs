//! A supervised thread, its CPU and its enforcer in virtual time, with all that can go wrong
//! between them: preemption, blocking without records, checks that come late or early, changes of
//! level that take time or are refused.

use super::busiest_window;
use proptest::prelude::*;
use sporadic::{
    BlockedInterval, BudgetServer, Corrected, Level, Low, Nanos, Params, Readings, Reservation,
    Tuning, Verdict,
};

/// Room for replenishments.
pub const ROOM: usize = 16;

/// The enforcer's knowledge of blocking inside callbacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Knowledge {
    /// Every switch is recorded.
    Records,
    /// At most this many blocks between two readings are recorded; with more, records are lost.
    Overflow(usize),
    /// A counter says whether the thread blocked since the last reading, but not when.
    Counter,
    /// Nothing.
    Nothing,
}

/// The actions of the thread and its CPU.
#[derive(Debug, Clone, Copy)]
pub enum Step {
    /// The thread has the CPU, at whatever level.
    Run(Nanos),
    /// A more urgent thread has it.
    Preempted(Nanos),
    /// The thread blocks inside its callback.
    Inside(Nanos),
    /// The thread waits, and says so. When it goes on, it may first have to wait for the CPU.
    Wait { span: Nanos, held_up: Nanos },
    /// Another thread reads the account.
    Observe,
    /// The CPU became free.
    PullIn,
}

/// The machine around the thread.
#[derive(Debug, Clone)]
pub struct Setup {
    pub budget: Nanos,
    pub period: Nanos,
    pub max_repl: u16,
    pub tuning: Tuning,
    pub knowledge: Knowledge,
    /// A check comes so late (negative: early, together with another thread's), in turn.
    pub latencies: Vec<i64>,
    /// A change of level takes this long, and the thread runs on meanwhile.
    pub change_takes: Nanos,
    /// Whether the system refuses a change, one after the other.
    pub refusals: Vec<bool>,
}

impl Setup {
    /// The most that a check can be late.
    pub fn latest(&self) -> Nanos {
        let latest = self.latencies.iter().copied().max().unwrap_or(0);
        latest.max(0).cast_unsigned()
    }

    /// The longest that a lowering can be refused.
    fn longest_refusal(&self) -> Nanos {
        let twice = self.refusals.iter().chain(&self.refusals);
        let (mut row, mut longest) = (0, 0);
        for &refused in twice {
            row = if refused { row + 1 } else { 0 };
            longest = longest.max(row);
        }
        longest * (self.tuning.backoff(self.budget) + self.latest() + self.change_takes)
    }

    /// The stated latency: how much more than its budget a thread can consume.
    pub fn stated(&self) -> Nanos {
        let put_off = self.tuning.backoff(self.budget).max(self.tuning.min_rearm);
        let lower = self.latest() + put_off + self.change_takes;
        let raise = self.latest() + self.change_takes;
        lower + raise + self.tuning.slack + self.longest_refusal()
    }
}

/// The thread, its CPU clock and its supervisor.
#[derive(Clone)]
pub struct World {
    pub setup: Setup,
    pub r: Reservation<Corrected<ROOM>>,
    pub now: Nanos,
    pub cpu: Nanos,
    /// When the thread consumed CPU time at the high level.
    pub high: Vec<(Nanos, Nanos)>,
    /// Moments at which no budget waited for it: it waited itself, or was low and none was due.
    pub anchors: Vec<Nanos>,
    /// Changes refused so far.
    pub refused: u64,
    /// A raise was refused: the thread was kept from its level, as if by others from the CPU.
    pub kept_low: bool,
    intervals: Vec<BlockedInterval>,
    ran: Nanos,
    blocked: Option<Nanos>,
    /// It blocked, or was blocked, since the last reading.
    was_blocked: bool,
    turn: usize,
    /// Changes of level that were asked for.
    verdicts: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Does {
    Runs,
    /// It wants to run, and a more urgent thread does.
    IsKept,
    Waits,
}

impl World {
    /// A thread that has just begun to run.
    pub fn new(setup: Setup) -> Self {
        let low = Low::Background(6);
        let params = Params::new(60, low, setup.budget, setup.period, setup.max_repl).unwrap();
        let server = Corrected::new(params, 0).unwrap();
        let server = server.with_min_chunk(setup.tuning.slack);
        let mut world = Self {
            r: Reservation::new(server, setup.tuning, 0, 0),
            setup,
            now: 0,
            cpu: 0,
            high: Vec::new(),
            anchors: vec![0],
            refused: 0,
            kept_low: false,
            intervals: Vec::new(),
            ran: 0,
            blocked: None,
            was_blocked: false,
            turn: 0,
            verdicts: 0,
        };
        world.activate(0);
        world
    }

    pub fn step(&mut self, step: Step) {
        match step {
            Step::Run(span) => self.pass(span, Does::Runs),
            Step::Preempted(span) => self.pass(span, Does::IsKept),
            Step::Inside(span) => {
                self.blocked = Some(self.now);
                self.was_blocked = true;
                self.pass(span, Does::Waits);
                let out_at = self.blocked.take().unwrap();
                let (ran, in_at) = (core::mem::take(&mut self.ran), self.now);
                self.intervals.push(BlockedInterval { ran, out_at, in_at });
            }
            Step::Wait { span, held_up } => {
                let (now, cpu) = (self.now, self.cpu);
                self.reading(|r, readings| r.block(now, cpu, readings));
                self.pass(span, Does::Waits);
                let woken = self.now;
                self.pass(held_up, Does::IsKept);
                self.activate(woken);
            }
            Step::Observe => {
                let (now, cpu) = (self.now, self.cpu);
                self.reading(|r, readings| r.observe(now, cpu, readings));
            }
            Step::PullIn => {
                self.r.pull_in(self.now);
            }
        }
        self.check();
    }

    fn activate(&mut self, woken: Nanos) {
        self.intervals.clear();
        (self.ran, self.was_blocked) = (0, false);
        self.r.activate(woken, self.now, self.cpu);
    }

    /// One call with what is known since the last one.
    fn reading<T>(
        &mut self,
        call: impl FnOnce(&mut Reservation<Corrected<ROOM>>, Readings<'_>) -> T,
    ) -> T {
        let intervals = core::mem::take(&mut self.intervals);
        let blocked = core::mem::replace(&mut self.was_blocked, self.blocked.is_some());
        self.ran = 0;
        let readings = match self.setup.knowledge {
            Knowledge::Records => Readings::Exact(&intervals),
            Knowledge::Overflow(room) if intervals.len() <= room => Readings::Exact(&intervals),
            Knowledge::Counter if !blocked => Readings::Exact(&[]),
            _ => Readings::Unknown,
        };
        call(&mut self.r, readings)
    }

    /// Time passes, and checks come when they are due.
    fn pass(&mut self, span: Nanos, does: Does) {
        let end = self.now + span;
        while let Some(at) = self.r.check_at() {
            let latencies = &self.setup.latencies;
            let late = latencies[self.turn % latencies.len()];
            let floor = self.now
                + if late < 0 {
                    self.setup.tuning.min_rearm
                } else {
                    0
                };
            let fires = at.saturating_add_signed(late).max(floor);
            if fires > end {
                break;
            }
            self.turn += 1;
            self.advance(fires - self.now, does);
            let (now, cpu) = (self.now, self.cpu);
            let verdict = self.reading(|r, readings| r.judge(now, cpu, readings));
            self.obey(verdict, does);
        }
        self.advance(end.saturating_sub(self.now), does);
    }

    fn obey(&mut self, verdict: Verdict, does: Does) {
        let Some(level) = verdict.change else { return };
        self.advance(self.setup.change_takes, does);
        let refusals = &self.setup.refusals;
        let verdict = self.verdicts;
        self.verdicts += 1;
        if !refusals.is_empty() && refusals[verdict % refusals.len()] {
            self.refused += 1;
            self.kept_low |= level == Level::High;
            self.r.refused(self.now);
        } else {
            let _ = self.r.applied(level, self.now, self.cpu);
        }
    }

    fn advance(&mut self, span: Nanos, does: Does) {
        let from = self.now;
        self.now += span;
        let due = self.r.server().chunks().next().map_or(0, |head| head.time);
        let none_due = self.r.level() == Level::Low && due > from;
        if span > 0 && does == Does::Waits {
            self.anchors.push(self.now);
        } else if span > 0 && none_due {
            self.anchors.push(self.now.min(due));
        }
        if does != Does::Runs || span == 0 {
            return;
        }
        self.cpu += span;
        self.ran += span;
        if self.r.level() == Level::High {
            self.high.push((from, self.now));
        }
    }

    /// (c) and (d), and the structure of the server.
    fn check(&self) {
        let counters = self.r.counters();
        assert_eq!(
            counters.cpu_high + counters.cpu_low,
            self.r.last_reading().0,
            "CPU time is not conserved"
        );
        super::check_chunks(self.r.server());
        if self.r.is_runnable() || self.r.level() == Level::Low {
            let at = self.r.check_at().expect("nobody looks after it");
            let (_, read_at) = self.r.last_reading();
            let tuning = self.setup.tuning;
            let funds = self.r.server().available(read_at) + tuning.slack;
            let put_off = tuning.backoff(self.setup.budget).max(tuning.min_rearm);
            if self.r.level() == Level::High && self.setup.refusals.is_empty() {
                assert!(
                    at <= read_at + funds.max(put_off),
                    "a check at {at}: {:?}",
                    self.r
                );
            }
        }
    }

    /// (c) from outside: what the thread consumed at the high level is what the account says.
    pub fn check_account(&mut self) {
        let (now, cpu) = (self.now, self.cpu);
        if self.r.is_runnable() {
            self.reading(|r, readings| r.observe(now, cpu, readings));
            let high: Nanos = self.high.iter().map(|(from, to)| to - from).sum();
            assert_eq!(self.r.counters().cpu_high, high, "high");
            assert_eq!(self.r.counters().cpu_low, self.cpu - high, "low");
        }
    }

    /// (a) for a thread that is kept waiting: a window of one to three periods that begins without
    /// budget waiting has that many budgets and the stated latency.
    pub fn check_windows_without_budget_waiting(&self) {
        for periods in 1..=3 {
            for &start in &self.anchors {
                let end = start + periods * self.setup.period;
                let overlap =
                    |&(from, to): &(Nanos, Nanos)| to.min(end).saturating_sub(from.max(start));
                let had: Nanos = self.high.iter().map(overlap).sum();
                let bound = periods * self.setup.budget + self.setup.stated();
                assert!(
                    had <= bound,
                    "{had} in {periods} periods from {start}, {bound} allowed: {:?}",
                    self.high
                );
            }
        }
    }

    /// (a): in windows of one to three periods at most that many budgets, `more` budgets for a
    /// thread that was kept waiting, and the stated latency.
    pub fn check_windows(&self, more: Nanos) {
        let more = more.max(u64::from(self.kept_low));
        for periods in 1..=3 {
            let most = busiest_window(&self.high, periods * self.setup.period);
            let bound = (periods + more) * self.setup.budget + self.setup.stated();
            assert!(
                most <= bound,
                "{most} in {periods} periods, {bound} allowed: {:?}",
                self.high
            );
        }
    }
}

/// Linux's constants, so that budgets of 50 us are small.
pub const TUNING: Tuning = Tuning::LINUX;

pub fn knowledge() -> impl Strategy<Value = Knowledge> {
    prop_oneof![
        Just(Knowledge::Records),
        (0..3usize).prop_map(Knowledge::Overflow),
        Just(Knowledge::Counter),
        Just(Knowledge::Nothing),
    ]
}

/// Budgets from 20 us to 70 ms, at 1 to 100 % of the CPU.
pub fn budget_and_period() -> impl Strategy<Value = (Nanos, Nanos)> {
    let budget = prop_oneof![
        20_000..200_000u64,
        200_000..5_000_000u64,
        5_000_000..70_000_000u64
    ];
    (budget, 1..=100u64).prop_map(|(budget, share)| (budget, budget * 100 / share))
}

prop_compose! {
    pub fn setups()(
        (budget, period) in budget_and_period(),
        max_repl in 1..=16u16,
        knowledge in knowledge(),
        latencies in prop::collection::vec(-10_000..60_000i64, 1..8),
        change_takes in 0..20_000u64,
        refusals in prop_oneof![
            4 => Just(Vec::new()),
            1 => prop::collection::vec(any::<bool>(), 1..6)
                .prop_filter("some must succeed", |all| all.iter().any(|refused| !refused)),
        ],
    ) -> Setup {
        Setup {
            budget, period, max_repl, tuning: TUNING, knowledge, latencies, change_takes, refusals,
        }
    }
}

/// Steps with spans relative to the budget and the period.
pub fn steps(
    setup: &Setup,
    preempted: bool,
    most: usize,
) -> impl Strategy<Value = Vec<Step>> + use<> {
    let (budget, period) = (setup.budget, setup.period);
    let short = 1..budget.max(2);
    let long = 1..2 * period;
    let wait = if preempted { 0..period } else { 0..1 };
    let step = prop_oneof![
        4 => short.clone().prop_map(Step::Run),
        4 => long.clone().prop_map(Step::Run),
        2 => short.clone().prop_map(Step::Inside),
        2 => long.clone().prop_map(Step::Inside),
        1 => (long.clone(), wait).prop_map(|(span, held_up)| Step::Wait { span, held_up }),
        1 => (short.clone(), Just(0)).prop_map(|(span, held_up)| Step::Wait { span, held_up }),
        1 => Just(Step::Observe),
        1 => Just(Step::PullIn),
        if preempted { 2 } else { 0 } => short.prop_map(Step::Preempted),
        if preempted { 2 } else { 0 } => long.prop_map(Step::Preempted),
    ];
    prop::collection::vec(step, 1..most)
}

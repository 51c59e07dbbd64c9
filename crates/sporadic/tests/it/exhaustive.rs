//! Bounded model check: every sequence of events up to a depth, with small numbers. In each state
//! the server is compared with its model and the invariants are asserted
//! (`crate::common::checked`).
//!
//! States that differ only by a shift in time are one state, so the depth can be large enough for
//! budget to come back several times.

use crate::common::checked::{CheckedCorrected, CheckedPosix};
use crate::common::simulator::Machine;
use crate::common::world::{Knowledge, Setup, Step, World};
use crate::common::{check_theorem, pairs, unit_times};
use sporadic::{Level, Nanos, Tuning};
use std::collections::HashSet;

const BUDGET: Nanos = 3;
const PERIOD: Nanos = 7;

#[derive(Clone, Copy)]
enum Event {
    /// The thread starts or ends a wait.
    Toggle,
    /// The thread runs one unit at High.
    Run,
    /// The thread runs that long, whatever is available: an overrun, a late demotion.
    Overrun(Nanos),
    /// The thread does not run, and the enforcer does not look meanwhile.
    Pass(Nanos),
}

const EVENTS: [Event; 6] = [
    Event::Toggle,
    Event::Run,
    Event::Overrun(1),
    Event::Overrun(4),
    Event::Pass(1),
    Event::Pass(5),
];

trait Checkable: Machine + Clone {
    /// Everything the future depends on, relative to `now`; forgets what it does not depend on.
    fn key(&mut self, now: Nanos) -> Vec<i64>;
}

fn relative(time: Nanos, now: Nanos) -> i64 {
    time.cast_signed() - now.cast_signed()
}

impl Checkable for CheckedCorrected {
    fn key(&mut self, now: Nanos) -> Vec<i64> {
        check_theorem(&self.log, BUDGET, PERIOD);
        // A use to come has an activation at the head or later: older windows are complete.
        let units = unit_times(&self.server);
        let model = self.model.sorted();
        self.log
            .retain(|&(e, _)| e + PERIOD > model[0].min(units[0]));
        self.log.sort_unstable();
        let log = self
            .log
            .iter()
            .flat_map(|&(e, n)| std::iter::repeat_n(e, n as usize));
        let all = units.iter().copied().chain(model).chain(log);
        let mut key: Vec<i64> = all.map(|time| relative(time, now)).collect();
        key.push(relative(self.server.chunks().count() as Nanos, 0));
        key
    }
}

impl Checkable for CheckedPosix {
    fn key(&mut self, now: Nanos) -> Vec<i64> {
        let activation = relative(self.server.activation_time(), now);
        let mut key = vec![
            i64::from(self.model.runnable),
            i64::from(self.model.overran),
            relative(self.model.avail, 0),
            relative(self.model.executed.len() as Nanos, 0),
            activation,
        ];
        for (time, amount) in pairs(self.server.replenishments()) {
            key.extend([relative(time, now), relative(amount, 0)]);
        }
        key
    }
}

/// Runs all sequences of `depth` events; returns the number of states and how often the level
/// was High and Low, so that a test can tell that it has seen something.
fn explore(start: impl Checkable, depth: usize) -> (usize, [usize; 2]) {
    let mut seen = HashSet::new();
    let mut levels = [0, 0];
    let mut frontier = vec![(start, 0, false)];
    for _ in 0..depth {
        let mut next = Vec::new();
        for (machine, now, runnable) in &frontier {
            for event in EVENTS {
                let (mut machine, mut now, mut runnable) = (machine.clone(), *now, *runnable);
                let high = runnable && machine.available(now) > 0;
                match event {
                    Event::Toggle => {
                        runnable = !runnable;
                        if runnable {
                            machine.activate(now);
                        } else {
                            machine.block(now);
                        }
                    }
                    Event::Run if high => {
                        now += 1;
                        machine.charge(1, now);
                    }
                    Event::Overrun(used) if runnable && (used > 1 || !high) => {
                        now += used;
                        machine.charge(used, now);
                    }
                    Event::Pass(span) => now += span,
                    Event::Run | Event::Overrun(_) => continue,
                }
                machine.check(now);
                levels[usize::from(machine.update(now) == Level::High)] += 1;
                let mut key = machine.key(now);
                key.push(i64::from(runnable));
                if seen.insert(key) {
                    next.push((machine, now, runnable));
                }
            }
        }
        frontier = next;
    }
    (seen.len(), levels)
}

fn explore_corrected(depth: usize, max_repl: u16, min_chunk: Nanos) {
    let start = CheckedCorrected::new(BUDGET, PERIOD, max_repl, min_chunk);
    let (states, levels) = explore(start, depth);
    println!("corrected, max_repl {max_repl}, min_chunk {min_chunk}: {states} states, {levels:?}");
    assert!(
        states > 5_000 && levels.iter().all(|&n| n > 1_000),
        "{states} states, {levels:?}"
    );
}

#[test]
fn corrected_equals_its_model() {
    explore_corrected(24, 3, 0);
}

#[test]
fn corrected_with_a_full_queue() {
    explore_corrected(18, 1, 0); // 3 chunks fit with max_repl 2 already
}

#[test]
fn corrected_with_a_smallest_chunk() {
    explore_corrected(16, 1, 2);
    explore_corrected(16, 3, 2);
    explore_corrected(12, 3, 9); // above B
}

/// Next steps of a thread and its CPU, in numbers as small as B = 10 and T = 20.
const STEPS: [Step; 9] = [
    Step::Run(1),
    Step::Run(4),
    Step::Run(15),
    Step::Preempted(6),
    Step::Preempted(25),
    Step::Inside(3),
    Step::Inside(25),
    Step::Wait {
        span: 5,
        held_up: 0,
    },
    Step::Observe,
];

/// All sequences of `depth` steps; returns how many worlds there were.
fn walk(world: &World, depth: usize, preempted: bool) -> u64 {
    if depth == 0 {
        return 1;
    }
    let steps = STEPS.into_iter().map(|step| {
        let kept_waiting = preempted || matches!(step, Step::Preempted(_));
        let mut next = world.clone();
        next.step(step);
        let knows = world.setup.knowledge != Knowledge::Nothing;
        next.check_windows(u64::from(kept_waiting && knows));
        walk(&next, depth - 1, kept_waiting)
    });
    1 + steps.sum::<u64>()
}

/// The theorem for the whole reservation; `REPLENISH_DEPTH` says how many steps.
#[test]
fn the_theorem_for_every_short_history() {
    let depth = std::env::var("REPLENISH_DEPTH").ok();
    let depth = depth.map_or(4, |depth| depth.parse().unwrap());
    let tuning = Tuning {
        slack: 1,
        min_rearm: 1,
        max_backoff: 2,
    };
    for knowledge in [
        Knowledge::Records,
        Knowledge::Overflow(0),
        Knowledge::Counter,
        Knowledge::Nothing,
    ] {
        for max_repl in [1, 4] {
            for latency in [0, 1] {
                let setup = Setup {
                    budget: 10,
                    period: 20,
                    max_repl,
                    tuning,
                    knowledge,
                    latencies: vec![latency],
                    change_takes: 0,
                    refusals: Vec::new(),
                };
                let worlds = walk(&World::new(setup), depth, false);
                println!("{knowledge:?}, max_repl {max_repl}, late {latency}: {worlds} histories");
            }
        }
    }
}

#[test]
fn posix_equals_the_rules() {
    for max_repl in [1, 2, 3, 4] {
        let (states, levels) = explore(CheckedPosix::new(BUDGET, PERIOD, max_repl), 24);
        println!("posix, max_repl {max_repl}: {states} states, {levels:?}");
        assert!(
            states > 500 && levels.iter().all(|&n| n > 200),
            "{states} states, {levels:?}"
        );
    }
}

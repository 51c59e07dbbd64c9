//! A thread, an adversary and a late enforcer, driven by a random script.

use proptest::prelude::*;
use sporadic::{Level, Nanos};

/// One step of the script. Spans are in units, the period is at most 30 of them.
#[derive(Debug, Clone, Copy)]
pub enum Step {
    /// The thread leaves its wait (if it waits).
    Activate,
    /// The thread waits (if it does not).
    Block,
    /// The thread has the CPU for `span` if it is High and runnable; each time its budget ends it
    /// goes on for `late` until the enforcer lowers it. Otherwise the time passes.
    Run { span: Nanos, late: Nanos },
    /// A more urgent thread has the CPU: time passes, and the server is not looked at.
    Preempted { span: Nanos },
    /// The enforcer looks, with a clock that is `behind`.
    Update { behind: Nanos },
    /// The thread is charged far too late for `used`, whatever its level.
    Late { used: Nanos },
}

/// Many cases; what fails becomes a hand-made trace, not a file of seeds.
pub fn config() -> ProptestConfig {
    ProptestConfig {
        cases: 2_000,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// A script of up to 60 steps with an overrun of up to `max_late` per exhaustion.
pub fn script(max_late: Nanos) -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        3 => Just(Step::Activate),
        2 => Just(Step::Block),
        6 => (1..12u64, 0..=max_late).prop_map(|(span, late)| Step::Run { span, late }),
        2 => (1..40u64).prop_map(|span| Step::Preempted { span }),
        1 => (0..4u64).prop_map(|behind| Step::Update { behind }),
        1 => (0..=max_late * 20).prop_map(|used| Step::Late { used }),
    ];
    proptest::collection::vec(step, 1..60)
}

/// (B, T) with 1 <= B <= T <= 30.
pub fn budget_and_period() -> impl Strategy<Value = (Nanos, Nanos)> {
    (1..=30u64).prop_flat_map(|period| (1..=period.min(14), Just(period)))
}

/// The machine on which the script acts. Every method gets the time after the event.
pub trait Machine {
    fn activate(&mut self, now: Nanos);
    fn block(&mut self, now: Nanos);
    fn charge(&mut self, used: Nanos, now: Nanos);
    fn update(&mut self, now: Nanos) -> Level;
    fn available(&self, now: Nanos) -> Nanos;
    /// Called after each event.
    fn check(&mut self, now: Nanos);
}

/// Runs `script` and returns the intervals in which the thread ran at High.
pub fn play(machine: &mut impl Machine, script: &[Step]) -> Vec<(Nanos, Nanos)> {
    let mut now = 0;
    let mut runnable = false;
    let mut runs = Vec::new();
    for &step in script {
        match step {
            Step::Activate if !runnable => {
                runnable = true;
                machine.activate(now);
            }
            Step::Block if runnable => {
                runnable = false;
                machine.block(now);
            }
            Step::Activate | Step::Block => {}
            Step::Run { span, late } => {
                let end = now + span;
                while now < end {
                    if !(runnable && machine.update(now) == Level::High) {
                        now += 1;
                        continue;
                    }
                    let available = machine.available(now);
                    let used = if available <= end - now {
                        available + late
                    } else {
                        end - now
                    };
                    runs.push((now, now + used));
                    now += used;
                    machine.charge(used, now);
                    machine.check(now);
                }
            }
            Step::Preempted { span } => now += span,
            Step::Update { behind } => {
                machine.update(now.saturating_sub(behind));
            }
            Step::Late { used } => {
                now += used;
                machine.charge(used, now);
            }
        }
        machine.check(now);
    }
    runs
}

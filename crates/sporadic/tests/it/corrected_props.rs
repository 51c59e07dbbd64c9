//! Random traces of the corrected server: its invariants, the effective-activation theorem, and
//! agreement with a model that keeps each unit of budget by itself.

use crate::common::checked::CheckedCorrected as Checked;
use crate::common::simulator::{Machine, Step, budget_and_period, config, play, script};
use crate::common::{busiest_window, check_theorem, unit_times};
use proptest::prelude::*;
use sporadic::{BudgetServer, Level};

proptest! {
    #![proptest_config(config())]

    #[test]
    fn agrees_with_single_units((budget, period) in budget_and_period(), script in script(3)) {
        let mut machine = Checked::new(budget, period, 16, 0);
        assert!(machine.unlimited);
        play(&mut machine, &script);
        check_theorem(&machine.log, budget, period);
    }

    #[test]
    fn limits_only_delay(
        (budget, period) in budget_and_period(),
        max_repl in 1..5u16,
        min_chunk in 0..6u64,
        script in script(3),
    ) {
        let mut machine = Checked::new(budget, period, max_repl, min_chunk);
        play(&mut machine, &script);
        check_theorem(&machine.log, budget, period);
    }

    /// Of a server that is never preempted and never overruns, no window of length T holds more
    /// *execution* than B. (Of a preempted one it may: as of a periodic task that starts late.)
    #[test]
    fn execution_window_when_never_preempted(
        (budget, period) in budget_and_period(),
        max_repl in 1..17u16,
        min_chunk in 0..4u64,
        script in script(0),
    ) {
        let undisturbed: Vec<Step> =
            script.into_iter().filter(|step| !matches!(step, Step::Preempted { .. })).collect();
        let mut machine = Checked::new(budget, period, max_repl, min_chunk);
        let runs = play(&mut machine, &undisturbed);
        let most = busiest_window(&runs, period);
        prop_assert!(most <= budget, "{most} in one window: {runs:?}");
    }

    /// A loop that never waits gets B per T in the long run: overruns are paid back, no more.
    #[test]
    fn a_hog_gets_its_share(
        (budget, period) in budget_and_period(),
        max_repl in 1..17u16,
        lateness in proptest::collection::vec(0..4u64, 1..20),
        periods in 1..50u64,
    ) {
        let mut machine = Checked::new(budget, period, max_repl, 0);
        let mut late = lateness.iter().copied().cycle();
        let (mut now, mut executed) = (0, 0);
        machine.activate(0);
        while now < periods * period {
            if machine.update(now) == Level::Low {
                now = machine.server.next_replenishment().unwrap();
                continue;
            }
            let used = machine.available(now) + late.next().unwrap();
            (now, executed) = (now + used, executed + used);
            machine.charge(used, now);
            machine.check(now);
        }
        let due = now.div_ceil(period) * budget;
        prop_assert!(executed <= due + 3, "{executed} executed, {due} due");
        prop_assert!(executed + budget >= due, "{executed} executed, {due} due");
    }

    /// However a consumption is cut into charges, the state after it is the same, or budget comes
    /// later, if some of it is due for longer than a period by the time of the second charge.
    #[test]
    fn charges_add_up(
        (budget, period) in budget_and_period(),
        history in script(3),
        used in 0..100u64,
        cut in 0..100u64,
    ) {
        let mut machine = Checked::new(budget, period, 16, 0);
        play(&mut machine, &history);
        let (now, cut) = (machine.now, used.min(cut));
        let mut whole = machine.server.clone();
        whole.charge(used, now + used);
        let mut parts = machine.server.clone();
        parts.charge(cut, now + cut);
        let in_time = parts.chunks().all(|chunk| chunk.time + period >= now + cut);
        parts.charge(used - cut, now + used);
        if in_time {
            prop_assert_eq!(whole, parts);
        } else {
            let (whole, parts) = (unit_times(&whole), unit_times(&parts));
            prop_assert!(whole.iter().zip(&parts).all(|(whole, part)| whole <= part));
        }
    }
}

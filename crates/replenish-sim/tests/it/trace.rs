//! The trace's records of CPUs and budgets, for drawing schedules.

use replenish_sim::{Options, Policy, Releases, System, Thread, What, simulate};
use sporadic::{Low, Params};

const MS: u64 = 1_000_000;

#[test]
fn the_trace_tells_who_has_the_cpu_and_what_budgets_have_left() {
    let params = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 16).unwrap();
    let high = Policy::Sporadic(params);
    let system = System::on_one_cpu(vec![
        Thread::new("high", high)
            .released(Releases::periodic(10 * MS))
            .runs(10 * MS)
            .queue(100),
        Thread::new("low", Policy::Fifo { priority: 50 })
            .released(Releases::periodic(10 * MS))
            .runs(10 * MS)
            .queue(100),
    ]);
    let outcome = simulate(&system, &Options::until(200 * MS).traced()).unwrap();
    let budget: Vec<(u64, u64)> = outcome
        .trace
        .iter()
        .filter(|e| e.thread == 0)
        .filter_map(|e| match e.what {
            What::Budget { left } => Some((e.time, left)),
            _ => None,
        })
        .collect();
    assert_eq!(budget[..2], [(0, 0), (0, 30 * MS)]);
    for pair in budget.windows(2) {
        let ((from, before), (to, after)) = (&pair[0], &pair[1]);
        // It falls as time passes, or stays; it rises at one instant only.
        assert!(*after <= *before || from == to, "{budget:?}");
        assert!(before.saturating_sub(*after) <= to - from, "{budget:?}");
    }
    assert!(budget.contains(&(30 * MS, 0)) && budget.contains(&(100 * MS, 10 * MS)));

    // Every start on a CPU has its end there.
    let mut running = None;
    for event in &outcome.trace {
        match event.what {
            What::Run { .. } => assert_eq!(running.replace(event.thread), None),
            What::Preempt { .. } | What::Yield { .. } => {
                assert_eq!(running.take(), Some(event.thread));
            }
            _ => {}
        }
    }
}

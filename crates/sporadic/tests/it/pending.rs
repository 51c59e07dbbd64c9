//! The smallest sufficient number of pending replenishments: a full queue puts budget off.

use crate::common::{corrected, simulator::config};
use proptest::prelude::*;
use sporadic::{BudgetServer, Level};

proptest! {
    #![proptest_config(config())]

    /// With two or more places, who asks for at most B in any 2 T never finds the budget spent.
    #[test]
    fn half_of_the_budget_is_always_there(
        max_repl in 2..7u16,
        (budget, period) in (20..400u64, 1..10u64).prop_map(|(b, times)| (b, b * times)),
        calls in proptest::collection::vec((0..3_000u64, 0..=1_000u64), 1..200),
        every in 1..200u64,
    ) {
        // One call in `apart` at most, each for a share of what a window of 2 T then leaves to one.
        let apart = (2 * period / every).max(1);
        let most = budget / (2 * period / apart + 1);
        prop_assume!(most > 0);
        let mut server = corrected(budget, period, max_repl);
        let mut now = 0;
        for (wait, share) in calls {
            now += apart + wait * period / 1_000;
            let used = (share * most / 1_000).clamp(1, apart);
            server.activate(now);
            prop_assert!(server.available(now) >= used, "{used} of {:?} at {now}", server);
            server.charge(used, now + used);
            server.block(now + used);
        }
    }
}

/// A worker with 30 of 100 ms that asks for 5 % in small pieces: how many of `count` callbacks find
/// no budget.
fn unfunded(max_repl: u16, count: u64) -> u64 {
    let mut server = corrected(30_000_000, 100_000_000, max_repl);
    let mut without = 0;
    for start in (0..count).map(|i| i * 1_000_000) {
        server.activate(start);
        if server.update(start) == Level::Low {
            without += 1;
        } else {
            server.charge(50_000, start + 50_000);
        }
        server.block(start + 50_000);
    }
    without
}

/// With one replenishment pending, every callback puts the whole of it off, until the budget is
/// spent; then nothing is there for a period. On b209253, too: it follows from the one place that
/// there is, so `docs/servers.md` says how much, and that two are enough.
#[test]
fn one_pending_replenishment_is_put_off_by_each_callback() {
    let without = unfunded(1, 70_000);
    assert!((9_500..=10_000).contains(&without), "{without} of 70000");
    assert_eq!(unfunded(2, 70_000), 0);
}

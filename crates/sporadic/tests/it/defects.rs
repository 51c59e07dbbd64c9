//! The two defects of the POSIX server (Stanovich et al., RTAS 2010) on hand-made traces: it shows
//! both, the corrected server neither.

use crate::common::{busiest_window, corrected, pairs, posix};
use sporadic::{BudgetServer, Level, Nanos};

/// A runnable thread that never waits, never preempted and lowered in time, from `now` to `end`:
/// the intervals in which it ran at High.
fn hog(server: &mut impl BudgetServer, mut now: Nanos, end: Nanos) -> Vec<(Nanos, Nanos)> {
    let mut runs = Vec::new();
    while now < end {
        if server.update(now) == Level::Low {
            now = server.next_replenishment().unwrap_or(end);
            continue;
        }
        let until = now + server.available(now);
        runs.push((now, until));
        server.charge(until - now, until);
        now = until;
    }
    runs
}

/// B = 2, T = 10. Two overruns of one unit each, and never again.
fn two_overruns(server: &mut impl BudgetServer) {
    server.activate(0);
    server.charge(1, 1);
    server.block(1); // half of the budget comes back at 10 ...
    server.activate(5);
    server.charge(2, 7); // ... one unit was left, two were used; the other half comes back at 15
}

#[test]
fn budget_amplification() {
    let mut posix = posix(2, 10, 4);
    two_overruns(&mut posix);
    // R3 forgot one unit, R6 gives it back nevertheless.
    assert_eq!(pairs(posix.replenishments()), [(10, 1), (15, 2)]);
    assert_eq!(posix.update(10), Level::High);
    assert_eq!(posix.available(10), 1);
    posix.charge(2, 12); // the second overrun
    assert_eq!(pairs(posix.replenishments()), [(15, 2), (20, 2)]);
    // From now on no overrun any more. 15-17, 20-22, 25-27, ...: 2 in every 5, twice the budget.
    let runs = hog(&mut posix, 12, 115);
    assert_eq!(runs[..3], [(15, 17), (20, 22), (25, 27)]);
    assert_eq!(runs.iter().map(|(from, to)| to - from).sum::<Nanos>(), 40); // of 100 ns
    assert_eq!(busiest_window(&runs, 10), 4);
}

#[test]
fn no_budget_amplification() {
    let mut corrected = corrected(2, 10, 4);
    two_overruns(&mut corrected);
    // The unit too many has activation 10, so nothing is left for 10.
    assert_eq!(pairs(corrected.chunks()), [(15, 1), (20, 1)]);
    assert_eq!(corrected.update(10), Level::Low);
    corrected.charge(2, 12); // what the enforcer could not prevent is a debt again
    assert_eq!(pairs(corrected.chunks()), [(25, 1), (30, 1)]);
    // 25-26, 30-31, 35-36, ...: 1 in every 5, the budget; and the debt has been paid: 3 + 2 used
    // by 12, nothing until 25.
    let runs = hog(&mut corrected, 12, 125);
    assert_eq!(runs[..3], [(25, 26), (30, 31), (35, 36)]);
    assert_eq!(runs.iter().map(|(from, to)| to - from).sum::<Nanos>(), 20); // of 100 ns
    assert_eq!(busiest_window(&runs, 10), 2);
}

/// B = 4, T = 8, half of the CPU. The same with two overruns of two units each; returns at 12.
fn two_large_overruns(server: &mut impl BudgetServer) {
    server.activate(0);
    server.charge(2, 2);
    server.block(2); // half of the budget comes back at 8
    server.activate(4);
    server.charge(4, 8); // two were left, four were used; the other half comes back at 12
    server.update(8);
    server.charge(4, 12); // POSIX: two were back, four were used, four come back at 16
}

#[test]
fn amplification_up_to_continuous_execution() {
    let mut posix = posix(4, 8, 4);
    two_large_overruns(&mut posix);
    assert_eq!(pairs(posix.replenishments()), [(12, 4), (16, 4)]);
    let runs = hog(&mut posix, 12, 92);
    assert_eq!(runs.len(), 20); // 12-16, 16-20, ..., 88-92: no gap
    assert_eq!(busiest_window(&runs, 80), 80);

    let mut corrected = corrected(4, 8, 4);
    two_large_overruns(&mut corrected);
    // Used 10: 2 of activation 0, 2 of 4, 2 of 8, 2 of 12, 2 of 16.
    assert_eq!(pairs(corrected.chunks()), [(20, 2), (24, 2)]);
    let runs = hog(&mut corrected, 12, 100);
    assert_eq!(busiest_window(&runs, 80), 40);
}

/// B = 3, T = 10. Returns after the thread has used everything at 13.
fn replenished_while_preempted(server: &mut impl BudgetServer) {
    server.activate(0);
    server.charge(2, 2);
    server.block(2); // 2 come back at 10, 1 is left
    server.activate(8); // with 1 unit; preempted at once
    assert_eq!(server.update(10), Level::High); // the 2 are back
    assert_eq!(server.available(10), 3);
    server.charge(3, 13); // runs from 10 to 13
    assert_eq!(server.update(13), Level::Low);
}

#[test]
fn premature_replenishment() {
    let mut posix = posix(3, 10, 4);
    replenished_while_preempted(&mut posix);
    // All three come back at 8 + 10, also the two that were not there before 10.
    assert_eq!(pairs(posix.replenishments()), [(18, 3)]);
    assert_eq!(hog(&mut posix, 13, 20), [(18, 21)]);
}

/// Units of the trace above by the time they became available: 1 at 8, 2 at 10, 3 at 18. The window
/// [10, 20) holds five, and the check that the corrected server passes says so.
#[test]
#[should_panic(expected = "5 units in [10, 10+10)")]
fn premature_replenishment_breaks_the_theorem() {
    crate::common::check_theorem(&[(8, 1), (10, 2), (18, 3)], 3, 10);
}

#[test]
fn no_premature_replenishment() {
    let mut corrected = corrected(3, 10, 4);
    replenished_while_preempted(&mut corrected);
    assert_eq!(pairs(corrected.chunks()), [(18, 1), (20, 2)]);
    assert_eq!(hog(&mut corrected, 13, 22), [(18, 19), (20, 22)]);
}

//! Measurements on NuttX, on the board and under QEMU, against the emulation.

use replenish_bench::nuttx::emulated::{Row, experiment_1, experiment_2, two_threads};
use replenish_bench::nuttx::history::{Bugs, after_the_fixes, replay};

fn rows_within(bugs: Bugs, ms: u64) -> usize {
    let rows = replay(bugs);
    assert_eq!(rows.len(), 44);
    rows.iter().filter(|r| r.worst_difference() <= ms).count()
}

#[test]
fn both_historic_bugs_explain_what_the_paper_measured() {
    assert!(rows_within(Bugs::BOTH, 10) >= 43);
}

#[test]
fn without_the_bugs_the_measurements_stay_unexplained() {
    assert!(rows_within(Bugs::NONE, 10) < 20);
}

#[test]
fn neither_bug_alone_explains_them() {
    for stale_ready_list in [false, true] {
        let one = Bugs {
            stale_ready_list,
            reversed_subtraction: !stale_ready_list,
        };
        assert!(rows_within(one, 10) < 20);
    }
}

fn within_one_burst(rows: &[Row]) -> (usize, usize) {
    let good = rows.iter().filter(|r| r.worst_difference() <= 1).count();
    (good, rows.len())
}

#[test]
fn nuttx_under_qemu_does_what_the_emulation_does() {
    assert_eq!(within_one_burst(&experiment_2()), (40, 40));
    let first = experiment_1();
    let (good, all) = within_one_burst(&first);
    assert!(good >= 49 && all == 50, "{good} of {all}");
    assert!(first.iter().all(|row| row.worst_difference() <= 2));
    // Rows with two threads whose second thread started as the row says, within two ticks.
    let (good, all) = within_one_burst(&two_threads(2));
    assert!(good >= 17 && all == 20, "{good} of {all}");
}

#[test]
fn the_fixes_leave_a_budget_that_depends_on_phase() {
    for row in after_the_fixes() {
        let difference = row.measured_ms.abs_diff(row.simulated_ms);
        assert!(difference <= 100, "of 100 s: {row:?}");
    }
}

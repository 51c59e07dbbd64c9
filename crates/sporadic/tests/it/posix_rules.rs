//! The rules R1-R7 of POSIX (XSH 2.8.4), each on a hand-made trace with hand-computed numbers.
//! B = 3 and T = 10 unless said.

use crate::common::{pairs, posix};
use sporadic::{BudgetServer, Level, Posix};

/// (avail at `now`, pending replenishments).
fn state(server: &Posix<128>, now: u64) -> (u64, Vec<(u64, u64)>) {
    (server.available(now), pairs(server.replenishments()))
}

#[test]
fn r1_r5_r6_the_limit_is_the_budget_and_comes_back_a_period_after_the_activation() {
    let mut server = posix(3, 10, 4);
    server.activate(2);
    assert_eq!(server.update(2), Level::High);
    assert_eq!(server.available(2), 3); // R1
    server.charge(3, 5);
    assert_eq!(server.update(5), Level::Low); // R5
    assert_eq!(state(&server, 5), (0, vec![(12, 3)])); // R6: activated at 2, so at 2 + 10
    assert_eq!(server.next_replenishment(), Some(12));
    assert_eq!(server.update(11), Level::Low);
    assert_eq!(server.update(12), Level::High); // R7
    assert_eq!(state(&server, 12), (3, vec![]));
    assert_eq!(server.activation_time(), 12); // R2: raised while runnable
}

#[test]
fn r2_only_tail_insertions_at_p_set_the_activation_time() {
    let mut server = posix(3, 10, 4);
    server.activate(2);
    server.charge(3, 5); // Low
    server.block(6);
    server.activate(8); // blocked -> runnable at L: no R2
    assert_eq!(server.activation_time(), 2);
    server.block(9);
    assert_eq!(server.update(12), Level::High); // replenished while blocked: no R2
    assert_eq!(server.activation_time(), 2);
    server.activate(14);
    assert_eq!(server.activation_time(), 14);
}

#[test]
fn r2_an_activation_sees_what_came_back_before_it() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(3, 3);
    server.block(3);
    server.activate(12); // nobody looked at 10
    assert_eq!(server.update(13), Level::High);
    assert_eq!(server.activation_time(), 12);
}

#[test]
fn r2_a_thread_raised_late_is_activated_late() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(3, 3); // comes back at 10
    assert_eq!(server.update(12), Level::High); // noticed at 12
    server.charge(3, 15);
    assert_eq!(state(&server, 15), (0, vec![(22, 3)])); // the drift of the rules
}

#[test]
fn r3_a_preempted_thread_is_charged_and_schedules_nothing() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(1, 1); // preempted at 1
    assert_eq!(server.update(1), Level::High);
    assert_eq!(state(&server, 1), (2, vec![]));
    server.charge(2, 8); // runs again from 6
    assert_eq!(state(&server, 8), (0, vec![(10, 3)])); // one replenishment for both
}

#[test]
fn r3_an_overrun_is_clamped_and_r7_clamps_what_it_gives_back() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(5, 5);
    assert_eq!(state(&server, 5), (0, vec![(10, 5)])); // R6: all that was executed
    server.update(10);
    assert_eq!(state(&server, 10), (3, vec![])); // R7: not above B
}

#[test]
fn r4_a_blocking_thread_schedules_what_it_consumed() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(1, 1);
    server.block(1);
    assert_eq!(state(&server, 1), (2, vec![(10, 1)]));
    server.activate(4);
    server.block(4); // consumed nothing: schedules nothing
    assert_eq!(state(&server, 4), (2, vec![(10, 1)]));
    server.activate(5);
    server.charge(2, 7); // the limit, then it blocks: scheduled once
    server.block(7);
    assert_eq!(state(&server, 7), (0, vec![(10, 1), (15, 2)]));
    assert_eq!(server.update(10), Level::High);
    assert_eq!(state(&server, 10), (1, vec![(15, 2)]));
    assert_eq!(server.update(15), Level::High);
    assert_eq!(state(&server, 15), (3, vec![]));
}

#[test]
fn r6_a_replenishment_in_the_past_is_done_at_once() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(0, 9); // preempted until 9
    server.charge(2, 11);
    server.block(11); // due at 10
    assert_eq!(state(&server, 11), (3, vec![]));
    // The same with the limit: R5 lowers, R7 raises at once, and that is R2.
    server.activate(20);
    server.charge(3, 31); // preempted from 20 to 28; due at 30
    assert_eq!(server.update(31), Level::High);
    assert_eq!(state(&server, 31), (3, vec![]));
    assert_eq!(server.activation_time(), 31);
}

#[test]
fn r6_due_now_is_not_in_the_past_but_is_applied_by_the_update() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(1, 10);
    server.block(10);
    assert_eq!(pairs(server.replenishments()), [(10, 1)]);
    assert_eq!(server.available(10), 3); // foreseen
    assert_eq!(server.update(10), Level::High);
    assert_eq!(state(&server, 10), (3, vec![]));
}

#[test]
fn n_pending_replenishments_mean_the_low_level_whatever_is_available() {
    let mut server = posix(3, 10, 2);
    for start in [0, 3] {
        server.activate(start);
        server.charge(1, start + 1);
        server.block(start + 1);
    }
    // 1 of 3 is left, but two replenishments are pending.
    assert_eq!(pairs(server.replenishments()), [(10, 1), (13, 1)]);
    assert_eq!(server.update(4), Level::Low);
    assert_eq!(server.available(4), 0);
    server.activate(6);
    assert_eq!(server.activation_time(), 3); // at L
    assert_eq!(server.next_replenishment(), Some(10));
    assert_eq!(server.update(10), Level::High); // one of them has gone
    assert_eq!(state(&server, 10), (2, vec![(13, 1)]));
    assert_eq!(server.activation_time(), 10);
}

#[test]
fn a_replenishment_before_the_end_of_a_run_belongs_to_the_run() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(2, 2);
    server.block(2); // 2 come back at 10
    server.activate(9);
    server.charge(2, 11); // 1 was left at 9, but at 10 there were 2 more
    assert_eq!(server.update(11), Level::High);
    assert_eq!(state(&server, 11), (1, vec![]));
    assert_eq!(server.activation_time(), 9);
}

#[test]
fn a_wait_that_went_unseen_counts_as_one() {
    let mut server = posix(3, 10, 4);
    server.activate(0);
    server.charge(1, 1);
    server.activate(5);
    assert_eq!(state(&server, 5), (2, vec![(10, 1)]));
    assert_eq!(server.activation_time(), 5);
}

#[test]
fn what_is_charged_after_the_limit_belongs_to_the_same_replenishment() {
    for max_repl in [1, 4] {
        let mut server = posix(3, 10, max_repl);
        server.activate(0);
        server.charge(3, 3);
        assert_eq!(server.update(3), Level::Low);
        server.charge(2, 5); // it was lowered at 5 only
        assert_eq!(pairs(server.replenishments()), [(10, 5)]);
        server.block(6);
        assert_eq!(pairs(server.replenishments()), [(10, 5)]);
    }
}

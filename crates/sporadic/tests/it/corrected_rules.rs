//! The corrected server on hand-made traces with hand-computed numbers, where it matters next to
//! the POSIX server. B = 3 and T = 10 unless said; chunks are (time, amount).

use crate::common::{busiest_window, corrected, pairs, params, posix};
use sporadic::{BudgetServer, Consumed, Corrected, Kind, Level, Low, Server};

#[test]
fn without_overrun_preemption_or_limit_it_is_the_posix_server() {
    for kind in [Kind::Corrected, Kind::Posix] {
        let mut server = Server::<8>::new(kind, params(3, 10, 8), 0).unwrap();
        let mut seen = Vec::new();
        let mut look = |server: &mut Server<8>, now| {
            seen.push((
                now,
                server.update(now),
                server.available(now),
                server.pending(),
            ));
        };
        server.activate(0);
        server.charge(1, 1);
        server.block(1); // 1 at 10
        look(&mut server, 1);
        server.activate(4);
        server.charge(2, 6); // 2 at 14
        look(&mut server, 6);
        look(&mut server, 9);
        look(&mut server, 10);
        server.charge(1, 11); // 1 at 20
        look(&mut server, 11);
        look(&mut server, 14);
        server.block(14);
        look(&mut server, 20);
        let expected = [
            (1, Level::High, 2, 1),
            (6, Level::Low, 0, 2),
            (9, Level::Low, 0, 2),
            (10, Level::High, 1, 1),
            (11, Level::Low, 0, 2),
            (14, Level::High, 2, 1),
            (20, Level::High, 3, 0),
        ];
        assert_eq!(seen, expected, "{kind:?}");
    }
}

#[test]
fn what_is_used_comes_back_a_period_after_its_activation() {
    let mut server = corrected(3, 10, 4);
    server.activate(2);
    server.charge(3, 5);
    assert_eq!(pairs(server.chunks()), [(12, 3)]);
    assert_eq!(
        (server.update(11), server.update(12)),
        (Level::Low, Level::High)
    );
}

#[test]
fn a_block_splits_the_head() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(1, 1);
    server.block(1);
    assert_eq!(pairs(server.chunks()), [(0, 2), (10, 1)]);
    server.activate(4); // what is left is activated now
    assert_eq!(pairs(server.chunks()), [(4, 2), (10, 1)]);
    server.charge(2, 6);
    assert_eq!(pairs(server.chunks()), [(10, 1), (14, 2)]);
    assert_eq!(server.next_replenishment(), Some(10));
    assert_eq!(server.pending(), 2);
}

#[test]
fn an_activation_merges_what_is_due_and_leaves_what_is_not() {
    let mut server = corrected(4, 10, 4);
    for start in [0, 2, 4] {
        server.activate(start);
        server.charge(1, start + 1);
        server.block(start + 1);
    }
    assert_eq!(pairs(server.chunks()), [(4, 1), (10, 1), (12, 1), (14, 1)]);
    server.activate(12);
    assert_eq!(pairs(server.chunks()), [(12, 3), (14, 1)]);
    assert_eq!((server.available(12), server.available(14)), (3, 4));
}

#[test]
fn an_activation_while_low_changes_nothing() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(3, 3);
    server.block(3);
    server.activate(7);
    assert_eq!(pairs(server.chunks()), [(10, 3)]);
    assert_eq!(server.update(7), Level::Low);
}

#[test]
fn a_thread_raised_late_does_not_drift() {
    // POSIX comes back at 22 here: r2_a_thread_raised_late_is_activated_late.
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(3, 3);
    assert_eq!(server.update(12), Level::High); // due at 10, noticed at 12
    server.charge(3, 15);
    assert_eq!(pairs(server.chunks()), [(20, 3)]);
}

#[test]
fn preemption_keeps_the_activation() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(1, 1); // preempted from 1 to 10
    server.charge(2, 12);
    assert_eq!(pairs(server.chunks()), [(10, 3)]); // as a periodic task released at 0
    assert_eq!(server.available(12), 3);
}

/// On b209253 there was no limit: kept waiting for ten periods, a thread then executed eleven
/// budgets in one piece.
#[test]
fn budget_that_was_not_had_within_its_period_comes_later() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(1, 1); // preempted from 1 to 12
    server.charge(2, 14); // begun at 12: as if activated at 2
    assert_eq!(pairs(server.chunks()), [(10, 1), (12, 2)]);
    let mut server = corrected(3, 10, 4);
    server.activate(0); // preempted until 100
    for (used, now, back) in [(3, 103, 100), (3, 106, 110)] {
        assert_eq!(server.update(now - used), Level::High);
        server.charge(used, now);
        assert_eq!(pairs(server.chunks()), [(back, 3)]);
    }
    assert_eq!(server.update(106), Level::Low);
}

#[test]
fn execution_of_a_preempted_server_may_exceed_the_budget_in_a_window() {
    // The theorem is about activations. A periodic task (3, 10) that starts late does the same.
    let mut server = corrected(3, 10, 4);
    server.activate(0); // preempted until 7
    server.charge(3, 10);
    assert_eq!(server.update(10), Level::High);
    server.charge(3, 13); // 6 in [7, 13), with activations 0 and 10
    assert_eq!(pairs(server.chunks()), [(20, 3)]);
    assert_eq!(busiest_window(&[(7, 10), (10, 13)], 10), 6);
}

#[test]
fn an_overrun_is_taken_from_the_next_chunk() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(4, 4);
    assert_eq!(pairs(server.chunks()), [(10, 2), (20, 1)]);
    assert_eq!(server.update(10), Level::High);
    server.charge(2, 12);
    assert_eq!(pairs(server.chunks()), [(20, 3)]); // paid back
}

#[test]
fn an_overrun_of_several_budgets_takes_several_periods() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    let mut log = Vec::new();
    // 3 of activation 0, 3 of 10, 2 of 20.
    server.charge_with(8, 8, &mut |piece| log.push(piece));
    assert_eq!(pairs(server.chunks()), [(20, 1), (30, 2)]);
    let piece = |activation, amount, rounds| Consumed {
        activation,
        amount,
        rounds,
    };
    assert_eq!(log, [piece(0, 3, 2), piece(20, 2, 1)]); // 0 twice: at 0 and 0 + 10
}

#[test]
fn a_full_queue_merges_the_two_youngest_at_the_later_time() {
    let mut server = corrected(5, 10, 2);
    for start in [0, 2, 4] {
        server.activate(start);
        server.charge(1, start + 1);
        server.block(start + 1);
    }
    assert_eq!(pairs(server.chunks()), [(4, 2), (10, 1), (14, 2)]); // not (12, 1), (14, 1)
    // POSIX: two pending replenishments, so Low although 3 are left.
    let mut posix = posix(5, 10, 2);
    for start in [0, 2] {
        posix.activate(start);
        posix.charge(1, start + 1);
        posix.block(start + 1);
    }
    assert_eq!(posix.update(4), Level::Low);
    assert_eq!(server.update(5), Level::High);
}

#[test]
fn a_spent_head_makes_room_before_its_replenishment_is_queued() {
    let mut server = corrected(3, 10, 1);
    server.activate(0);
    server.charge(1, 1);
    assert_eq!(pairs(server.chunks()), [(0, 2), (10, 1)]); // full
    server.block(1);
    server.activate(5);
    server.charge(2, 7);
    assert_eq!(pairs(server.chunks()), [(10, 1), (15, 2)]); // no merge needed
}

#[test]
fn chunks_that_meet_become_one() {
    let mut server = corrected(3, 10, 4);
    server.activate(0);
    server.charge(4, 4); // (10, 2) (20, 1)
    server.charge(2, 12); // both parts of the debt end at 20
    assert_eq!(pairs(server.chunks()), [(20, 3)]);
}

#[test]
fn a_remnant_below_the_smallest_chunk_waits_for_the_next() {
    let mut server = corrected(10, 20, 4).with_min_chunk(3);
    assert_eq!(server.min_chunk(), 3);
    server.activate(0);
    server.charge(7, 7); // 3 left: enough
    assert_eq!(pairs(server.chunks()), [(0, 3), (20, 7)]);
    server.charge(1, 8); // 2 left: not enough
    assert_eq!(pairs(server.chunks()), [(20, 10)]);
    assert_eq!(server.update(8), Level::Low);
}

#[test]
fn a_sliver_that_becomes_the_head_waits_for_the_next() {
    let mut server = corrected(10, 20, 4).with_min_chunk(3);
    server.activate(0);
    server.charge(1, 1);
    server.block(1); // (0, 9) (20, 1)
    server.activate(5);
    server.charge(9, 14); // (20, 1) is the head now: not worth a wake-up
    assert_eq!(pairs(server.chunks()), [(25, 10)]);
    assert_eq!(server.next_replenishment(), Some(25));
}

#[test]
fn the_smallest_chunk_does_not_matter_without_a_next_one() {
    let server = corrected(2, 20, 4).with_min_chunk(3);
    assert_eq!(server.available(0), 2); // B itself is below
}

#[test]
fn a_fresh_server_has_its_budget_from_its_creation_on() {
    let server = Corrected::<4>::new(params(3, 10, 4), 100).unwrap();
    assert_eq!(pairs(server.chunks()), [(100, 3)]);
    assert_eq!((server.available(100), server.pending()), (3, 0));
    assert_eq!(server.params().low(), Low::Background(6));
}

#[test]
fn all_servers_are_used_alike() {
    let p = params(3, 10, 4);
    let servers: [&mut (dyn BudgetServer + Send + Sync); 3] = [
        &mut Corrected::<4>::new(p, 0).unwrap(),
        &mut sporadic::Posix::<4>::new(p, 0).unwrap(),
        &mut Server::<4>::new(Kind::default(), p, 0).unwrap(),
    ];
    for server in servers {
        assert_eq!(server.params(), &p);
        server.activate(1);
        server.charge(3, 4);
        server.block(4);
        assert_eq!(server.update(5), Level::Low);
        assert_eq!((server.available(10), server.available(11)), (0, 3));
        assert_eq!(
            (server.next_replenishment(), server.pending()),
            (Some(11), 1)
        );
    }
}

//! The emulation of NuttX's policy, event by event as its description says.

use replenish_bench::nuttx::policy::{Arm, Effects, Nuttx};
use sporadic::Level;

fn arm(slot: usize, delay: i32) -> Option<Arm> {
    Some(Arm { slot, delay })
}

fn effects(arm: [Option<Arm>; 2], level: Level) -> Effects {
    Effects {
        arm,
        level: Some(level),
    }
}

#[test]
fn the_cycle_runs_by_the_wall_clock_alone() {
    let mut server = Nuttx::<4>::new(30, 100, 4);
    assert_eq!(server.start(0), effects([arm(0, 30), None], Level::High));
    assert_eq!(server.resume(0), Effects::default());
    for _ in 0..30 {
        server.tick();
    }
    assert_eq!(
        server.expire(0, 31),
        effects([arm(0, 70), None], Level::Low)
    );
    assert_eq!(
        server.expire(0, 102),
        effects([arm(0, 30), None], Level::High)
    );
}

#[test]
fn time_without_the_cpu_is_credited_half_a_period_later() {
    let mut server = Nuttx::<4>::new(30, 100, 4);
    assert!(server.start(0).level.is_some());
    assert_eq!(server.resume(0), Effects::default());
    server.suspend(10);
    assert_eq!(server.resume(15).arm, [arm(1, 45), None]);
    assert_eq!(server.taken(), 2);
    assert_eq!(
        server.expire(1, 61),
        effects([arm(1, 5), None], Level::High)
    );
    let end = effects([None; 2], Level::Low);
    assert_eq!(server.expire(1, 67), end);
    assert_eq!(server.taken(), 1);
}

#[test]
fn a_slot_missed_altogether_is_lost_on_resuming() {
    let mut server = Nuttx::<4>::new(30, 100, 4);
    assert!(server.start(0).level.is_some());
    assert_eq!(server.resume(30), Effects::default());
    assert_eq!(server.taken(), 1);
}

#[test]
fn suspended_at_the_end_of_the_budget_is_credited_or_granted_without_bound() {
    let end = |reversed| {
        let mut server = Nuttx::<4>::new(30, 100, 4).with_reversed_subtraction(reversed);
        assert!(server.start(0).level.is_some());
        assert_eq!(server.resume(0), Effects::default());
        server.suspend(20);
        let effects = server.expire(0, 31);
        (effects, server)
    };
    let (fixed, _) = end(false);
    assert_eq!(fixed, effects([arm(1, 39), arm(0, 70)], Level::Low));
    let (reversed, mut server) = end(true);
    assert_eq!(reversed, effects([arm(1, 61), arm(0, 70)], Level::Low));
    // The grant has a negative length, which the kernel's timers refuse: it never ends.
    assert_eq!(
        server.expire(1, 93),
        effects([arm(1, -11), None], Level::High)
    );
    assert_eq!(server.taken(), 2);
}

#[test]
fn a_full_pool_drops_the_credit() {
    let mut server = Nuttx::<4>::new(30, 100, 1);
    assert!(server.start(0).level.is_some());
    assert_eq!(server.resume(0), Effects::default());
    server.suspend(10);
    assert_eq!(server.resume(15).arm, [None; 2]);
}

#[test]
fn a_full_budget_never_goes_low() {
    let mut server = Nuttx::<4>::new(100, 100, 4);
    assert!(server.start(0).level.is_some());
    assert_eq!(server.resume(0), Effects::default());
    assert_eq!(
        server.expire(0, 101),
        effects([arm(0, 100), None], Level::High)
    );
    assert_eq!(server.expire(3, 101), Effects::default());
    assert_eq!(server.expire(9, 101), Effects::default());
}

//! The two reliable stream machines against each other over a link that loses, duplicates, delays
//! and reorders, in virtual time: everything arrives exactly once, in order, for every seed.

use replenish_bench::lossy::{Direction, Link, Load, Outcome, Repair, SAMPLES, point, transfer};
use replenish_xrce::Nanos;

const MILLI: Nanos = 1_000_000;

fn load(samples: u32, usual: usize, large: usize) -> Load {
    Load {
        samples,
        shortest: 4,
        usual,
        large,
        large_every: 50,
    }
}

fn run(seed: u64, link: Link, load: Load) -> Outcome {
    let outcome = transfer(seed, link, load, Repair::Selective);
    let Outcome {
        sent,
        delivered,
        duplicated,
        lost,
        ..
    } = outcome;
    let all = u64::from(load.samples);
    let context = format!("seed {seed}, {link:?}, {outcome:?}");
    assert_eq!(
        (sent, delivered, duplicated, lost),
        (all, all, 0, 0),
        "{context}"
    );
    outcome
}

#[test]
fn everything_arrives_once_and_in_order_whatever_the_link_does() {
    for loss_percent in [0, 1, 10, 30] {
        for seed in 0..5 {
            let link = Link {
                loss_percent,
                duplicate_percent: 5,
                delay_min: MILLI,
                delay_max: 50 * MILLI,
            };
            let outcome = run(seed, link, load(2_000, 54, 5_000));
            println!("loss {loss_percent} %, seed {seed}: {outcome:?}");
        }
    }
}

#[test]
fn a_hundred_thousand_messages_over_a_bad_link() {
    let link = Link {
        loss_percent: 30,
        duplicate_percent: 2,
        delay_min: MILLI,
        delay_max: 50 * MILLI,
    };
    // Large enough that the numbers wrap, several times.
    let load = Load {
        large_every: 500,
        ..load(100_000, 500, 50_000)
    };
    let outcome = run(42, link, load);
    assert!(outcome.stats.sent > 65_536, "{:?}", outcome.stats);
}

#[test]
fn fragments_of_fifty_kilobytes() {
    let link = Link {
        loss_percent: 10,
        duplicate_percent: 5,
        delay_min: MILLI,
        delay_max: 10 * MILLI,
    };
    run(7, link, load(500, 54, 50_000));
}

#[test]
fn the_same_seed_gives_the_same_trace() {
    let link = Link {
        loss_percent: 20,
        duplicate_percent: 5,
        delay_min: MILLI,
        delay_max: 9 * MILLI,
    };
    let trace = |seed| run(seed, link, load(500, 54, 2_000)).trace;
    assert_eq!(trace(1), trace(1));
    assert_ne!(trace(1), trace(2));
}

#[test]
fn only_what_was_lost_is_sent_again() {
    // Steady delay, so that every gap is a loss.
    let steady = |loss_percent| Link {
        loss_percent,
        duplicate_percent: 0,
        delay_min: 5 * MILLI,
        delay_max: 5 * MILLI,
    };
    for loss in [1, 10] {
        let outcome = run(3, steady(loss), load(20_000, 54, 600));
        let (resent, sent) = (outcome.stats.resent, outcome.stats.sent);
        // Heartbeats and retransmissions are among the datagrams that the link has lost.
        assert!(resent <= outcome.datagrams_lost + sent / 100, "{outcome:?}");
    }
    let outcome = run(3, steady(0), load(20_000, 54, 600));
    assert_eq!(outcome.stats.resent, 0);
}

#[test]
fn the_link_loses_what_it_says_and_treats_both_ways_alike() {
    let link = Link {
        loss_percent: 10,
        duplicate_percent: 2,
        delay_min: MILLI,
        delay_max: 3 * MILLI,
    };
    for direction in [Direction::Forth, Direction::Back] {
        let fates: Vec<_> = (0..100_000).map(|k| link.fate(9, direction, k)).collect();
        let lost = fates.iter().filter(|fate| fate.delay.is_none()).count();
        assert!((9_500..10_500).contains(&lost), "{lost}");
        let twice = fates.iter().filter(|fate| fate.duplicate.is_some()).count();
        assert!((1_600..2_000).contains(&twice), "{twice}");
        let delays = fates.iter().filter_map(|fate| fate.delay);
        assert!(
            delays
                .clone()
                .all(|delay| (MILLI..=3 * MILLI).contains(&delay))
        );
    }
}

#[test]
fn repair_costs_at_most_half_of_what_go_back_n_costs() {
    for loss in [0, 1, 10] {
        let point = point(loss, SAMPLES, 1);
        println!("{point:?}");
        let counts = (point.sent, point.delivered, point.duplicated, point.lost);
        assert_eq!(counts, (SAMPLES.into(), SAMPLES.into(), 0, 0));
        // Without loss, go-back-N has the better of it here: it knows the longest delay, while ours
        // has to guess whether a gap is one.
        let half = 2 * point.retransmitted_bytes <= point.go_back_n_bytes;
        assert!(half || loss == 0, "{point:?}");
    }
}

#[test]
fn a_loss_costs_round_trips_and_not_heartbeats() {
    // With 10 % loss four windows of five lose something, and each such loss takes a round trip to
    // be known and another to be repaired: two and a half times as long as without, or three with
    // delays that differ.
    for (delay_min, delay_max) in [(MILLI, MILLI), (5 * MILLI, 5 * MILLI), (MILLI, 5 * MILLI)] {
        let speed = |loss_percent| {
            let link = Link {
                loss_percent,
                duplicate_percent: 1,
                delay_min,
                delay_max,
            };
            run(1, link, load(10_000, 300, 50_000)).messages_per_second()
        };
        let (perfect, rough) = (speed(0), speed(10));
        println!("{delay_min}..{delay_max} ns: {perfect:.0}/s, with 10 % loss {rough:.0}/s");
        assert!(rough * 3.5 > perfect, "{perfect} {rough}");
    }
}

//! The paper's experiments, simulated, against the theory of its text.

use replenish_bench::paper::Point;

const MS: u64 = 1_000_000;

#[test]
fn experiment_1_is_a_straight_line() {
    for budget in 1..=9 {
        let counts = Point::experiment_1(budget * 10 * MS).run(0).unwrap();
        assert_eq!(counts.high_answers, 4 * budget);
        assert_eq!(counts.low_answers, 40 - 4 * budget);
        assert_eq!(counts.background, 0);
    }
    let mut fifo = Point::experiment_1(10 * MS);
    fifo.reservation = None;
    let counts = fifo.run(0).unwrap();
    assert_eq!((counts.high_answers, counts.low_answers), (40, 0));
}

#[test]
fn experiment_2_gives_what_the_low_worker_sleeps_to_the_background() {
    for percent in (0..=90).step_by(10) {
        let counts = Point::experiment_2(percent).run(0).unwrap();
        let part = |whole: u64| whole * u64::from(percent) / 100;
        // B/T + (1 - B/T) x of the window, to one burst.
        let ideal = 120 * MS + part(280 * MS);
        let high = counts.high_priority + counts.background;
        assert!(high.abs_diff(ideal) <= 10 * MS, "{percent}: {high} {ideal}");
        assert!(counts.high_answers.abs_diff(ideal / (10 * MS)) <= 1);
        assert!(
            counts.low_answers.abs_diff(28) <= 4,
            "{percent}: {counts:?}"
        );
    }
}

#[test]
fn what_is_out_of_range_is_named() {
    let error = Point::experiment_1(0).run(0).unwrap_err();
    assert!(error.to_string().contains("budget"), "{error}");
}

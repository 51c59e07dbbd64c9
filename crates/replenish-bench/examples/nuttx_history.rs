//! Prints the replay of the paper authors' measurements, for each combination of the two bugs.
use replenish_bench::nuttx::history::{Bugs, Row, after_the_fixes, replay};

fn main() {
    for (name, stale_ready_list, reversed_subtraction) in [
        ("both bugs", true, true),
        ("only the reversed subtraction", false, true),
        ("only the stale ready list", true, false),
        ("no bugs", false, false),
    ] {
        let rows = replay(Bugs {
            stale_ready_list,
            reversed_subtraction,
        });
        let good = rows
            .iter()
            .filter(|row| row.worst_difference() <= 10)
            .count();
        println!("{name}: {good} of {} rows within 10 ms", rows.len());
        for experiment in 1..=4 {
            let of = rows.iter().filter(|row| row.experiment == experiment);
            let sum: u64 = of.map(Row::total_difference).sum();
            println!("  experiment {experiment}: sum of differences {sum} ms");
        }
        if std::env::args().any(|arg| arg == "--rows") {
            for row in rows {
                println!(
                    "  {} {:3} measured {:?} simulated {:?} skew {:?} worst {}",
                    row.experiment,
                    row.swept_budget_ms,
                    row.measured_ms,
                    row.simulated_ms,
                    row.skew_ticks,
                    row.worst_difference()
                );
            }
        }
    }
    println!("30 of 100 ms beside another budget, after the fixes, high-priority ms in 100 s:");
    for row in after_the_fixes() {
        println!(
            "  {:2} ms: measured {} simulated {}",
            row.budget_ms, row.measured_ms, row.simulated_ms
        );
    }
}

//! Prints the replay of the measurements of NuttX under QEMU; an argument sets the tolerance in
//! ticks for the phase of the second thread (default 2).
use replenish_bench::nuttx::emulated::{Row, experiment_1, experiment_2, two_threads};

fn show(name: &str, rows: &[Row]) {
    let good = rows
        .iter()
        .filter(|row| row.worst_difference() <= 1)
        .count();
    println!("{name}: {good} of {} rows within 1 burst", rows.len());
    for row in rows {
        println!(
            "  {}: measured {:?} simulated {:?} skew {:?} worst {}",
            row.setup,
            row.measured,
            row.simulated,
            row.skew_ticks,
            row.worst_difference()
        );
    }
}

fn main() {
    let tolerance = std::env::args().nth(1).and_then(|arg| arg.parse().ok());
    show("experiment 1", &experiment_1());
    show("experiment 2", &experiment_2());
    show("two threads", &two_threads(tolerance.unwrap_or(2)));
}

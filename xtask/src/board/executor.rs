//! `cargo xtask board experiment executor`: Experiment 1 on the executor itself, all in one image.
//!
//! An answer takes 10 ms of its worker's CPU time, handling included. Held to:
//! - high answers what its budget allows, within one burst, and its CPU time says the same;
//! - low gets the time that no task above it has used, within two bursts: dispatcher, ping worker
//!   and enforcer take their part of the processor, and the report says how much;
//! - CPU times of all tasks, switches included, and the time before the first ping are the time
//!   that passed;
//! - nothing was allocated after the start.

use super::case::{BURST_MS, LENGTH_MS};
use super::experiment::conclude;
use super::qemu;
use crate::output::Outcome;
use serde_json::{Value, json};
use std::path::Path;

/// Between the start and the first ping no task has anything to do.
const FIRST_PING_NS: f64 = 10e6;
const BURST_NS: f64 = BURST_MS as f64 * 1e6;

/// The most CPU time that tasks use before the first ping; sleeps are not recorded until then.
const START_NS: f64 = 0.5e6;

/// Runs the sweep, prints a table, writes JSON.
pub(crate) fn run(path: Option<&Path>) -> Outcome {
    let image = qemu::build("executor")?;
    let budgets: Vec<u64> = (1..=9).map(|i| i * 10).collect();
    // Two at a time: each point is a process of its own.
    let mut results = Vec::new();
    for pair in budgets.chunks(2) {
        let ends = std::thread::scope(|scope| {
            let runs: Vec<_> = pair
                .iter()
                .map(|b| scope.spawn(|| qemu::measure(&image, &[b.to_string()])))
                .collect();
            runs.into_iter()
                .map(|r| r.join().unwrap_or_else(|_| Err("a run panicked".into())))
                .collect::<Vec<_>>()
        });
        for (budget, end) in pair.iter().zip(ends) {
            results.push((*budget, end?));
        }
    }
    println!(
        "{:>9} {:>15} {:>15} {:>14} {:>12} {:>14}",
        "budget ms", "high (theory)", "low (theory)", "high's CPU ms", "others ms", "nobody's ms"
    );
    let (mut points, mut wrong) = (Vec::new(), Vec::new());
    for (budget, result) in &results {
        points.push(judge(*budget, result, &mut wrong)?);
    }
    let right =
        "High is within one answer of theory at every point, low within two of what is left.";
    conclude("executor", &points, &wrong, right, path)
}

/// One point: its line of the table and its JSON.
fn judge(budget: u64, result: &Value, wrong: &mut Vec<String>) -> Outcome<Value> {
    let number = |key: &str| {
        let value = result.get(key).and_then(Value::as_f64);
        value.ok_or_else(|| format!("the image does not tell {key}"))
    };
    let tasks = result.get("tasks").and_then(Value::as_array);
    let tasks = tasks.ok_or("the image does not tell its tasks")?;
    let cpu = |name: &str| {
        let task = tasks
            .iter()
            .find(|t| t.get("name").and_then(Value::as_str) == Some(name));
        let cpu = task.and_then(|t| t.get("cpu_ns")?.as_f64());
        cpu.ok_or_else(|| format!("the image has no task {name}"))
    };
    let elapsed = number("elapsed_ns")?;
    let (high, low) = (number("high")?, number("low")?);
    let (high_cpu, low_cpu) = (cpu("high")?, cpu("low")?);
    let others = cpu("dispatcher")? + cpu("ping")? + cpu("enforcer")?;
    let theory = (budget * LENGTH_MS / 100 / BURST_MS) as f64;
    // After the wait for the first ping, every instant belongs to a task.
    let nobodys = elapsed - FIRST_PING_NS - high_cpu - low_cpu - others;
    let left = (elapsed - FIRST_PING_NS - high_cpu - others - nobodys) / BURST_NS;
    println!(
        "{budget:>9} {:>15} {:>15} {:>14.2} {:>12.1} {:>14.1}",
        format!("{high} ({theory})"),
        format!("{low} ({left:.1})"),
        high_cpu / 1e6,
        others / 1e6,
        nobodys / 1e6
    );
    let mut hold = |what: bool, why: String| {
        if !what {
            wrong.push(format!("budget {budget} ms: {why}"));
        }
    };
    hold(
        (high - theory).abs() <= 1.0,
        format!("high answered {high}, theory says {theory}"),
    );
    hold(
        (high_cpu - theory * BURST_NS).abs() <= BURST_NS,
        format!("high used {high_cpu} ns, not {theory} bursts"),
    );
    hold(
        (low - left).abs() <= 2.0,
        format!("low answered {low}, {left:.1} bursts were left for it"),
    );
    hold(
        (-START_NS..=0.0).contains(&nobodys),
        format!("{nobodys} ns are nobody's"),
    );
    let pings = number("pings")?;
    let wanted = (LENGTH_MS / 10) as f64;
    hold(
        (wanted - 1.0..=wanted).contains(&pings),
        format!("{pings} pings instead of {wanted}"),
    );
    let refused = number("heap_refused")?;
    hold(
        refused == 0.0,
        format!("{refused} allocations after the start"),
    );
    Ok(json!({
        "budget_ms": budget,
        "period_ms": 100,
        "high_answered": high,
        "low_answered": low,
        "expected_high": theory,
        "expected_low": left,
        "others_ms": others / 1e6,
        "high_cpu_percent": high_cpu * 100.0 / elapsed,
        "low_cpu_percent": low_cpu * 100.0 / elapsed,
        "board": result,
    }))
}

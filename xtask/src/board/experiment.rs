//! Runs the cases of an experiment on the board and holds them against theory: budgeted workers
//! within one burst, in the sweep the worker below within two.

use super::case::{self, BURST_MS, LENGTH_MS, Name, Worker};
use super::qemu;
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::path::Path;

/// Runs, prints a table, writes JSON.
pub(crate) fn run(name: Name, path: Option<&Path>) -> Outcome {
    let image = qemu::build("budgets")?;
    let mut points = Vec::new();
    let mut wrong = Vec::new();
    println!(
        "{:<46} bursts (theory) of each worker",
        "workers: priority/background/budget/period"
    );
    for workers in case::cases(name) {
        let mut words = vec![LENGTH_MS.to_string()];
        words.extend(workers.iter().map(Worker::word));
        let result = qemu::measure(&image, &words)?;
        if points.is_empty() && qemu::measure(&image, &words)? != result {
            wrong.push(format!("{words:?}: a second run differs from the first"));
        }
        let (line, point) = judge(&workers, &result, name == Name::BudgetSweep, &mut wrong)?;
        println!(
            "{:<46} {line}",
            words.get(1..).unwrap_or_default().join(" ")
        );
        points.push(point);
    }
    let right = "Every budget was given within one burst (in the sweep, the rest within two).";
    conclude(&case::label(name), &points, &wrong, right, path)
}

/// Writes the JSON of an experiment; prints `right`, or fails with the violations.
pub(crate) fn conclude(
    name: &str,
    points: &[Value],
    wrong: &[String],
    right: &str,
    path: Option<&Path>,
) -> Outcome {
    let result = json!({
        "experiment": name,
        "board": "olimex-stm32-h405 in QEMU, FreeRTOS",
        "length_ms": LENGTH_MS,
        "burst_ms": BURST_MS,
        "points": points,
        "off": wrong,
    });
    write(path, &result)?;
    if wrong.is_empty() {
        println!("{right}");
        Ok(())
    } else {
        Err(wrong.join("\n"))
    }
}

/// Compares one case with theory; the line of the table and the JSON.
fn judge(
    workers: &[Worker],
    result: &Value,
    sweep: bool,
    wrong: &mut Vec<String>,
) -> Outcome<(String, Value)> {
    let measured = result.get("workers").and_then(Value::as_array);
    let measured = measured.filter(|m| m.len() == workers.len());
    let measured = measured.ok_or("the image tells of another number of workers")?;
    let mut line = String::new();
    let mut point = json!({ "workers": measured, "enforcer": result.get("enforcer") });
    if let Some(first) = workers.first().filter(|w| w.budget > 0) {
        set(&mut point, "budget_ms", json!(first.budget));
        set(&mut point, "period_ms", json!(first.period));
    }
    for (i, ((worker, got), ms)) in workers
        .iter()
        .zip(measured)
        .zip(case::expected(workers))
        .enumerate()
    {
        let number = |key: &str| got.get(key).and_then(Value::as_f64).unwrap_or(0.0);
        let cpu = (number("cpu_high_ns") + number("cpu_low_ns")) / 1e6;
        let theory = ms / BURST_MS as f64;
        // A worker that never ends a burst is judged by its CPU time.
        let consumed = cpu / BURST_MS as f64;
        let bursts = if worker.endless {
            consumed
        } else {
            number("bursts")
        };
        line.push_str(&format!("{bursts:.0} ({theory:.1})  "));
        let names = [
            ["high_answered", "expected_high", "high_cpu_percent"],
            ["low_answered", "expected_low", "low_cpu_percent"],
        ];
        // Two workers are the paper's high and low: the names of the experiments on Linux.
        if let (2, Some([answered, expected, percent])) = (workers.len(), names.get(i)) {
            set(&mut point, answered, json!(bursts));
            set(&mut point, expected, json!(theory));
            set(&mut point, percent, json!(cpu * 100.0 / LENGTH_MS as f64));
        }
        // A budget is judged by CPU time, so that a burst that is cut by the end counts as far as
        // it went. The switches are paid from the lowest worker's share.
        let (value, allowed) = match worker.budget {
            0 if sweep => (bursts, 2.0),
            0 => continue,
            _ => (consumed, 1.0),
        };
        if (value - theory).abs() > allowed {
            wrong.push(format!(
                "{}: {value:.2} bursts, theory says {theory:.2}, allowed {allowed} apart",
                worker.word()
            ));
        }
    }
    Ok((line, point))
}

fn set(point: &mut Value, key: &str, value: Value) {
    if let Some(map) = point.as_object_mut() {
        map.insert(key.into(), value);
    }
}

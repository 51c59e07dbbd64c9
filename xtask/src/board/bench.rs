//! `cargo xtask board bench`: what switching and handing over cost, in instructions.

use super::qemu;
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::path::Path;

/// Runs the image `bench`, prints a table, writes JSON.
pub(crate) fn run(path: Option<&Path>) -> Outcome {
    let image = qemu::build("bench")?;
    let result = qemu::measure(&image, &[])?;
    if qemu::measure(&image, &[])? != result {
        return Err(String::from("a second run differs from the first"));
    }
    let figures = result.get("instructions").and_then(Value::as_object);
    let figures = figures.ok_or("the image tells no instructions")?;
    println!("{:<24} {:>12}", "on the board", "instructions");
    for (name, meaning) in NAMES {
        let count = figures.get(*name).and_then(Value::as_u64);
        let count = count.ok_or_else(|| format!("the image does not tell {name}"))?;
        if count == 0 {
            return Err(format!("{name} takes no instruction: not measured"));
        }
        println!("{name:<24} {count:>12}   {meaning}");
    }
    write(
        path,
        &json!({
            "board": "olimex-stm32-h405 in QEMU, FreeRTOS",
            "ns_per_instruction": result.get("ns_per_instruction"),
            "instructions": figures,
        }),
    )
}

const NAMES: &[(&str, &str)] = &[
    (
        "context_switch",
        "out of a task and into one, CPU time of both noted",
    ),
    ("hand_off", "from set to the waiter, which runs at once"),
    (
        "interrupt_to_task",
        "from an interrupt to the task it signals",
    ),
    ("set_without_waiter", "set and taken, nobody waits"),
    ("lock_and_unlock", "mutex with inheritance, not contended"),
    (
        "activate_and_block",
        "a budgeted worker wakes and waits again",
    ),
    ("read_clock", "monotonic time in ns"),
    ("read_cpu_time", "CPU time of the calling task"),
];

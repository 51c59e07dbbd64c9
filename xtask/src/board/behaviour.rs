//! `cargo xtask board test`: every case of the image `behaviour` on a fresh boot, reported like a
//! test runner does. Some cases must end with a message; the message is checked.

use super::qemu;
use crate::output::{Outcome, write};
use serde_json::json;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// The longest time of a case on the host.
const LIMIT: Duration = Duration::from_secs(60);

/// One case: its name, and the words that its output must contain.
struct Case {
    name: &'static str,
    says: &'static [&'static str],
    /// The board is to stop, not to go on.
    stops: bool,
}

const fn passes(name: &'static str, says: &'static [&'static str]) -> Case {
    Case {
        name,
        says,
        stops: false,
    }
}

const fn stops(name: &'static str, says: &'static [&'static str]) -> Case {
    Case {
        name,
        says,
        stops: true,
    }
}

const CASES: &[Case] = &[
    passes("lock-inherits", &[]),
    passes("lock-chain", &[]),
    passes("lock-in-background", &[]),
    passes("lock-in-suspension", &[]),
    passes("lock-order", &[]),
    passes("lock-limited", &[]),
    passes("suspend", &[]),
    passes("blocking-is-free", &[]),
    passes("cpu-time-exact", &["each preemption"]),
    passes("defect-suspended-in-lock", &[]),
    passes("defect-inherited", &[]),
    passes("defect-shares", &[]),
    passes("defect-small-and-blocking", &[]),
    passes("defect-small-pieces", &[]),
    passes("hand-off", &[]),
    passes("hand-off-interrupt", &[]),
    passes("timers-ordered", &[]),
    passes("timeouts", &[]),
    passes("sleep", &["late by at most"]),
    passes("long-clock", &[]),
    passes("granted", &[]),
    passes("refused", &[]),
    passes("equals-in-order", &[]),
    passes("idle", &["60 s: 15 interrupts of the timer"]),
    passes("idle-ten-timers", &["10 s: 1000 releases"]),
    passes("executor-granted", &["granted FIFO 60"]),
    passes("executor-refused", &["odd"]),
    passes("executor-panic", &["(mad) halted", "a callback's mistake"]),
    passes(
        "executor-log",
        &["WARN replenish: failing/timer:0: callback failed (8 times): out of paper"],
    ),
    passes("panic", &["(mad) halted", "the worker's mistake"]),
    passes(
        "heap-sealed",
        &[
            "(greedy): the heap is sealed: 100 bytes refused",
            "(greedy) halted",
        ],
    ),
    passes("heap-refusal-handled", &["(main): the heap is sealed"]),
    stops(
        "stack-overflow",
        &["(digger) needs more than its 2048 bytes of stack"],
    ),
    stops(
        "stack-overflow-deep",
        &["(digger) needs more than its 2048 bytes of stack"],
    ),
];

/// Runs the cases whose name contains `filter`; fails if one does.
pub(crate) fn run(filter: Option<&str>, path: Option<&Path>) -> Outcome {
    let image = qemu::build("behaviour")?;
    let chosen = CASES
        .iter()
        .filter(|c| filter.is_none_or(|f| c.name.contains(f)));
    let (mut passed, mut failed, mut results) = (0, 0, Vec::new());
    for case in chosen {
        let ended = boot(&image, case.name)?;
        let wrong = ended.judge(case);
        let seconds = ended.took.as_secs_f64();
        match &wrong {
            None => passed += 1,
            Some(_) => failed += 1,
        }
        let verdict = if wrong.is_none() { "ok" } else { "FAILED" };
        println!("test {:<24} {verdict:<7} {seconds:>5.1} s", case.name);
        if let Some(wrong) = &wrong {
            println!("  {wrong}");
            ended.text.lines().for_each(|line| println!("  | {line}"));
        }
        results.push(json!({
            "name": case.name, "passed": wrong.is_none(), "seconds": seconds, "printed": ended.text,
        }));
    }
    write(
        path,
        &json!({ "passed": passed, "failed": failed, "cases": results }),
    )?;
    println!("\n{passed} passed, {failed} failed");
    match (passed, failed) {
        (_, 1..) => Err(String::from("a case failed on the board")),
        (0, 0) => Err(String::from("no case has such a name")),
        _ => Ok(()),
    }
}

/// The end of a boot.
struct Ended {
    text: String,
    /// `None`: it was still running at the end of its time.
    success: Option<bool>,
    took: Duration,
}

impl Ended {
    fn judge(&self, case: &Case) -> Option<String> {
        match self.success {
            None => return Some(format!("still running after {LIMIT:?}")),
            Some(true) if case.stops => return Some("it did not stop the board".into()),
            Some(false) if !case.stops => return Some("the image says that it failed".into()),
            Some(_) => {}
        }
        if self.text.contains("wrong:") {
            return Some("an expectation did not hold".into());
        }
        let missing = case.says.iter().find(|what| !self.text.contains(**what));
        missing.map(|what| format!("it did not say `{what}`"))
    }
}

/// Boots once, with a time limit: a case that hangs is a failure, not a hang of this program.
fn boot(image: &Path, case: &str) -> Outcome<Ended> {
    let begin = Instant::now();
    let mut child = qemu::command(image, &[case.to_string()], false)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| format!("qemu-system-arm: {e}"))?;
    let success = loop {
        if let Some(status) = child.try_wait().map_err(|e| e.to_string())? {
            break Some(status.success());
        }
        if begin.elapsed() > LIMIT {
            child.kill().map_err(|e| e.to_string())?;
            break None;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let output = child.wait_with_output().map_err(|e| e.to_string())?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    Ok(Ended {
        text,
        success,
        took: begin.elapsed(),
    })
}

//! `trace --ctf` as ROS 2's readers see it: babeltrace2.

use crate::common::{BIN, Scratch, stderr};
use crate::missing;
use crate::recorded::Program;
use replenish_recorder::{Kind, View};
use replenish_testkit::harness::{Trial, trial};
use std::process::Command;

/// Begin and end of each callback of a recording that has both, by handle.
fn callbacks(bytes: &[u8]) -> Vec<(String, u64, u64)> {
    let view = View::read(bytes).unwrap();
    let names = view.names(bytes);
    let mut all = Vec::new();
    for thread in &view.threads {
        let mut open = None;
        for event in thread.events(bytes).0 {
            match event.kind {
                Kind::Begin => open = Some(event),
                Kind::End => {
                    if let Some(begin) = open.take().filter(|b| b.name == event.name) {
                        let (_, name) = names[begin.name as usize].clone().unwrap();
                        all.push((name, begin.time, event.time));
                    }
                }
                _ => {}
            }
        }
    }
    all.sort();
    all
}

/// The value of a field in a line of babeltrace2.
fn field<'a>(line: &'a str, name: &str) -> &'a str {
    let (_, rest) = line.split_once(&format!("{name} = ")).unwrap();
    rest.split([',', ' ', '}']).next().unwrap()
}

fn babeltrace_reads_every_callback_of_a_killed_program() {
    let scratch = Scratch::new("ctf");
    let mut program = Program::start("ctf");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let file = program.file();
    let expected = callbacks(&std::fs::read(&file).unwrap());
    assert!(expected.len() > 5, "{}", expected.len());
    let out = scratch.path("ctf");
    let trace = || {
        let mut command = Command::new(BIN);
        command
            .arg("trace")
            .arg(&file)
            .arg("--ctf")
            .arg(&out)
            .output()
            .unwrap()
    };
    let output = trace();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(!trace().status.success(), "the directory is there");

    let mut babeltrace = Command::new("babeltrace2");
    let output = babeltrace.arg("--clock-cycles").arg(&out).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(stderr(&output), "");
    let text = String::from_utf8(output.stdout).unwrap();
    let mut symbols = std::collections::HashMap::new();
    let mut open = std::collections::HashMap::new();
    let mut seen = Vec::new();
    for line in text.lines() {
        let time = || -> u64 {
            let (time, _) = line.trim_start_matches('[').split_once(']').unwrap();
            time.trim().parse().unwrap()
        };
        if line.contains("ros2:rclcpp_callback_register:") {
            let symbol = field(line, "symbol").trim_matches('"').to_owned();
            symbols.insert(field(line, "callback").to_owned(), symbol);
        } else if line.contains("ros2:callback_start:") {
            open.insert(field(line, "callback").to_owned(), time());
        } else if line.contains("ros2:callback_end:") {
            let callback = field(line, "callback");
            let begin = open.remove(callback).unwrap();
            seen.push((symbols[callback].clone(), begin, time()));
        }
    }
    seen.sort();
    assert_eq!(seen.len(), expected.len());
    assert_eq!(seen, expected);
    for tracepoint in [
        "rcl_subscription_init",
        "rcl_timer_init",
        "rcl_publish",
        "rmw_take",
    ] {
        assert!(
            text.contains(&format!("ros2:{tracepoint}:")),
            "{tracepoint}"
        );
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    let read = trial(
        "babeltrace_reads_every_callback_of_a_killed_program",
        babeltrace_reads_every_callback_of_a_killed_program,
    );
    vec![read.skipped_if(missing("babeltrace2", "babeltrace2").as_deref())]
}

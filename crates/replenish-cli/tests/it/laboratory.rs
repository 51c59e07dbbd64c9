//! The laboratory's words in a robot's command.

use crate::common::{BIN, Scratch, run, stderr, stdout};
use std::path::Path;
use std::process::Command;

/// Copies a program by a process of its own. A file that this process wrote cannot be run for as
/// long as a child that another test is starting holds it open.
fn install(program: &str, to: &Path) {
    let status = Command::new("install")
        .args(["-m", "755", program])
        .arg(to)
        .status();
    assert!(status.unwrap().success());
}

#[test]
fn a_word_of_the_laboratory_says_where_it_is() {
    let scratch = Scratch::new("no-laboratory");
    let alone = scratch.path("replenish");
    install(BIN, &alone);
    let output = Command::new(alone)
        .arg("demo")
        .env("PATH", scratch.dir())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("replenish-bench"),
        "{}",
        stderr(&output)
    );
    assert!(stdout(&run(&["--help"])).contains("replenish-bench"));
}

#[test]
fn a_word_of_the_laboratory_becomes_its_program() {
    let scratch = Scratch::new("laboratory");
    let (robot, laboratory) = (scratch.path("replenish"), scratch.path("replenish-bench"));
    install(BIN, &robot);
    let script = scratch.path("script");
    std::fs::write(&script, "#!/bin/sh\necho \"got: $*\"; exit 7\n").unwrap();
    install(script.to_str().unwrap(), &laboratory);
    let output = Command::new(robot)
        .args(["bench", "handoff", "--samples", "1000"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(7));
    assert_eq!(stdout(&output), "got: bench handoff --samples 1000\n");
}

#[test]
fn a_word_that_is_none_is_a_usage_error() {
    assert_eq!(run(&["dmeo"]).status.code(), Some(2));
}

//! The laboratory's words in a robot's command.

use crate::common::{BIN, Scratch, run, stderr, stdout};
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

#[test]
fn a_word_of_the_laboratory_says_where_it_is() {
    let scratch = Scratch::new("no-laboratory");
    let alone = scratch.path("replenish");
    std::fs::copy(BIN, &alone).unwrap();
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
    std::fs::copy(BIN, &robot).unwrap();
    std::fs::write(&laboratory, "#!/bin/sh\necho \"got: $*\"; exit 7\n").unwrap();
    std::fs::set_permissions(&laboratory, std::fs::Permissions::from_mode(0o755)).unwrap();
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

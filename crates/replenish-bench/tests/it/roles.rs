//! The parts alone: what they say when something is missing, and how they end; and how every
//! command ends whose output is not read any more.

use crate::common::{BIN, Scratch, free_port, json, run, start, stderr};
use std::io::pipe;
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The longest time that any step may take on a busy machine.
const SOON: Duration = Duration::from_secs(60);

#[test]
fn a_port_in_use_is_named_at_once() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let begun = Instant::now();
    let output = run(&["agent", "--listen", &address]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains(&address), "{}", stderr(&output));
    assert!(begun.elapsed() < SOON);
}

#[test]
fn without_an_agent_both_sides_say_so() {
    let address = format!("127.0.0.1:{}", free_port());
    for part in ["ping", "pong"] {
        let begun = Instant::now();
        let output = run(&[part, "--agent", &address]);
        assert_eq!(output.status.code(), Some(1), "{part}: {}", stderr(&output));
        assert!(
            stderr(&output).contains(&address),
            "{part}: {}",
            stderr(&output)
        );
        assert!(begun.elapsed() < SOON, "{part}: {:?}", begun.elapsed());
    }
}

#[test]
fn ping_and_pong_by_hand_and_a_clean_end_on_signals() {
    let scratch = Scratch::new("by-hand");
    let mut agent = start(&["agent", "--listen", "127.0.0.1:0"]);
    let line = agent.expect_line("127.0.0.1:", SOON);
    let address = address_in(&line);
    let mut pong = start(&["pong", "--agent", &address, "--burst", "0"]);
    pong.expect_line("granted", SOON);
    let path = scratch.path("ping.json");
    let mut ping = start(&[
        "ping",
        "--agent",
        &address,
        "--interval",
        "20",
        "--seconds",
        "2",
        "--json",
        path.to_str().unwrap(),
    ]);
    assert!(ping.end(SOON).success());
    let totals = json(&path);
    for topic in 0..2 {
        let sent = totals["sent"][topic].as_u64().unwrap();
        let answered = totals["answered"][topic].as_u64().unwrap();
        assert!(sent >= 50, "{totals}");
        assert!(answered > 0 && answered <= sent, "{totals}");
    }
    pong.signal("INT");
    assert!(pong.end(SOON).success());
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
}

#[test]
fn an_agent_that_goes_away_is_noticed_and_both_sides_still_end() {
    let mut agent = start(&["agent", "--listen", "127.0.0.1:0"]);
    let address = address_in(&agent.expect_line("127.0.0.1:", SOON));
    let mut pong = start(&["pong", "--agent", &address, "--burst", "0"]);
    pong.expect_line("granted", SOON);
    let mut ping = start(&["ping", "--agent", &address, "--interval", "20"]);
    ping.expect_line("answered", SOON);
    agent.signal("KILL");
    agent.end(SOON);
    ping.expect_line("the agent does not answer", SOON);
    pong.expect_line("the agent does not answer", SOON);
    for part in [&mut ping, &mut pong] {
        part.signal("TERM");
        assert!(part.end(SOON).success());
    }
}

#[test]
fn wrong_values_name_the_option_and_the_range() {
    let cases: [(&[&str], &str, &str); 7] = [
        (&["demo", "--seconds", "0"], "--seconds", "1..=600"),
        (
            &["pong", "--budget", "120"],
            "--budget",
            "1..=100 (the period)",
        ),
        (&["pong", "--period", "1"], "--period", "2..=900"),
        (&["pong", "--background", "60"], "--background", "1..60"),
        (&["ping", "--cpu", "4000"], "--cpu", "one of the CPUs"),
        (
            &[
                "experiment",
                "budget-sweep",
                "--budgets",
                "10,95",
                "--period",
                "90",
            ],
            "--budgets",
            "1..=90",
        ),
        (
            &["experiment", "work-conserving", "--sleep", "101"],
            "--sleep",
            "0..=100",
        ),
    ];
    for (args, option, range) in cases {
        let output = run(args);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(
            text.contains(option) && text.contains(range),
            "{args:?}: {text}"
        );
    }
}

#[test]
fn a_result_file_that_cannot_be_written_is_refused_before_the_run() {
    let begun = Instant::now();
    let output = run(&["demo", "--json", "/nonexistent/x.json"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("/nonexistent/x.json"),
        "{}",
        stderr(&output)
    );
    assert!(begun.elapsed() < SOON);
}

/// The first `127.0.0.1:port` in a line.
fn address_in(line: &str) -> String {
    let from = line.find("127.0.0.1:").unwrap();
    line[from..]
        .chars()
        .take_while(|c| c.is_ascii_digit() || ".:".contains(*c))
        .collect()
}

#[test]
fn a_reader_that_goes_ends_every_command_quietly() {
    let robot = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../examples/robot/fits.toml"
    );
    let commands: [&[&str]; 7] = [
        &["plan", robot],
        &["simulate", robot],
        &["doctor"],
        &["experiment", "nuttx-history"],
        &["demo", "--report", "/dev/null"],
        &["agent", "--listen", "127.0.0.1:0"],
        &["--help"],
    ];
    for arguments in commands {
        let (reader, nobody) = pipe().unwrap();
        drop(reader);
        let mut command = Command::new(BIN);
        command.args(arguments).env("REPLENISH_LEDGER", "off");
        command.stdin(Stdio::null()).stdout(nobody);
        let output = command.stderr(Stdio::piped()).spawn().unwrap();
        let output = output.wait_with_output().unwrap();
        let said = stderr(&output);
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
        // As a shell has it of `yes | head`; help is the library's, which ends well.
        let expected = if arguments == ["--help"] { 0 } else { 141 };
        assert_eq!(
            output.status.code(),
            Some(expected),
            "{arguments:?}: {said}"
        );
    }
}

#[test]
fn what_goes_wrong_can_be_told_to_nobody() {
    let (reader, nobody) = pipe().unwrap();
    drop(reader);
    let mut command = Command::new(BIN);
    let status = command
        .args(["plan", "/nonexistent/robot.toml"])
        .stdin(Stdio::null())
        .stderr(nobody)
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(141));
}

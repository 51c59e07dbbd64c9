//! The examples do what they say, as processes: through an agent, and in one process without any.

use crate::common::agent::TestAgent;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A program that `cargo test` has built beside this test; a run of this test alone has not.
pub(crate) fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let profile = test.parent().and_then(Path::parent).unwrap();
    let program = profile.join("examples").join(name);
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("examples/{name}.rs"));
    let changed = |path: &Path| path.metadata().and_then(|m| m.modified()).ok();
    if changed(&program) < changed(&source) {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args([
            "build",
            "--quiet",
            "--package",
            "replenish",
            "--example",
            name,
        ]);
        if profile.ends_with("release") {
            cargo.arg("--release");
        }
        assert!(cargo.status().unwrap().success());
    }
    program
}

/// The lines an example prints, with these arguments; it ends by itself.
fn run(name: &str, args: &[&str]) -> Vec<String> {
    let ledger = std::env::temp_dir().join(format!("replenish-examples-{}", std::process::id()));
    let mut child = Command::new(program(name))
        .args(args)
        .env("REPLENISH_LEDGER", &ledger) // not among the programs of this host
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let end = Instant::now() + Duration::from_secs(60);
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if Instant::now() > end {
            child.kill().unwrap();
            panic!("{name} does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    std::fs::remove_dir_all(&ledger).ok();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(status.success(), "{name}: {status}\n{text}");
    text.lines().map(String::from).collect()
}

/// Runs an example both ways and hands its lines to `check`.
fn both(name: &str, check: impl Fn(&[String])) {
    let agent = TestAgent::start("127.0.0.1:0");
    check(&run(name, &[&agent.address.to_string()]));
    check(&run(name, &[]));
}

/// The numbers behind `text`, of the lines that begin with it.
fn numbers(lines: &[String], text: &str) -> Vec<i32> {
    let rest = lines.iter().filter_map(|line| line.strip_prefix(text));
    rest.map(|n| n.trim().parse().unwrap()).collect()
}

#[test]
fn ping_pong() {
    both("ping_pong", |lines| {
        assert!(numbers(lines, "answered: ")[0] >= 100);
        let has = |id: &str| lines.iter().any(|line| line.starts_with(id));
        assert!(has("/ping_pong/sub:/ping ") && has("/ping_pong/sub:/pong "));
    });
}

#[test]
fn services() {
    both("services", |lines| {
        for (service, sum, result) in [("add", "2 + 3", 5), ("add_slowly", "20 + 30", 50)] {
            let request = lines
                .iter()
                .find(|l| l.starts_with(&format!("{service}: request")));
            let reply = request.unwrap().replace("request", "reply to");
            let reply = reply.replace(sum, &result.to_string());
            assert!(lines.contains(&reply), "{reply}: {lines:?}");
        }
    });
}

#[test]
fn logical_execution_time() {
    both("logical_execution_time", |lines| {
        let readings = numbers(lines, "control: reading ");
        assert_eq!(readings, [1, 2, 3, 4, 5, 6]);
        let commands = numbers(lines, "monitor: command ");
        assert_eq!(commands, [0, 1, 2, 3, 4, 5], "of the round before");
    });
}

#[test]
fn trigger() {
    both("trigger", |lines| {
        assert_eq!(numbers(lines, "fusion: picture "), [1, 2, 3, 4, 5]);
        let readings = numbers(lines, "fusion: reading ");
        assert_eq!(readings.len(), 5, "one for each picture");
        assert!(readings.is_sorted());
    });
}

/// Every image reaches its viewer, its recorder and its tracker where the camera has filled it.
#[test]
fn camera() {
    let lines = run("camera", &[]);
    for reader in ["viewer", "tracker", "recorder"] {
        let images = numbers(&lines, &format!("{reader}: image "));
        assert!(
            images.is_sorted() && images.last() == Some(&10),
            "{lines:?}"
        );
    }
    assert_eq!(numbers(&lines, "copied: "), [0]);
}

#[test]
fn fibonacci() {
    both("fibonacci", |lines| {
        let at = |line: &str| lines.iter().position(|l| l == line);
        let result = at("succeeded: [1, 1, 2, 3, 5, 8, 13, 21]").unwrap();
        assert!(at("so far: [1]").unwrap() < result);
        let before = lines[..result]
            .iter()
            .filter(|l| l.starts_with("so far"))
            .count();
        assert_eq!(before, 8);
        assert!(lines[result..].iter().any(|l| l == "Cancel(0)"));
    });
}

#[test]
fn parameter_server() {
    both("parameter_server", |lines| {
        let is = |start: &str| -> Vec<&str> {
            let rest = lines.iter().filter_map(|l| l.strip_prefix(start));
            rest.collect()
        };
        assert_eq!(is("control: gain "), ["0.5", "1"]);
        assert_eq!(is("event: "), ["/controller gain = 1"]);
        let refused = "false gain: the arm resonates at 0.75";
        let range = "false gain = 2: allowed are 0..=1 in steps of 0.25";
        assert_eq!(is("result: "), [refused, range, "true "]);
    });
}

#[test]
fn lifecycle() {
    both("lifecycle", |lines| {
        let all = lines.iter().filter_map(|l| l.strip_prefix("state: "));
        let states: Vec<&str> = all.collect();
        let expected = [
            "configuring",
            "unconfigured",
            "configuring",
            "inactive",
            "activating",
            "active",
            "deactivating",
            "inactive",
            "shuttingdown",
            "finalized",
        ];
        assert_eq!(states, expected);
        let at = |line: &str| lines.iter().position(|l| l == line);
        assert!(at("manager: the first picture") > at("state: activating"));
        assert!(at("manager: the first picture") < at("state: shuttingdown"));
    });
}

/// Everything a newcomer reads first fits on a page and says how to run it.
#[test]
fn examples_are_short() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let files = std::fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().path());
    let mut seen = 0;
    for file in files.filter(|f| f.is_file()) {
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.lines().count() < 80, "{}", file.display());
        assert!(
            text.contains("//! Run: `") && text.contains("--example"),
            "{}",
            file.display()
        );
        seen += 1;
    }
    assert!(seen >= 6, "{seen}");
}

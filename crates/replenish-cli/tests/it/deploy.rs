//! The files in `deploy/`: the agent runs as the unit says.

use crate::common::{BIN, json, stderr};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn unit() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/replenish-agent.service");
    std::fs::read_to_string(path).unwrap()
}

fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    dir
}

/// The value of a setting that is there once.
fn setting(unit: &str, name: &str) -> String {
    let mut lines = unit.lines().filter_map(|line| line.strip_prefix(name));
    let value = lines.next().and_then(|rest| rest.strip_prefix('='));
    value
        .unwrap_or_else(|| panic!("no {name}"))
        .trim_matches('"')
        .to_owned()
}

/// With the unit's options it serves, writes its JSON, and SIGTERM ends it with exit code 0.
#[test]
fn the_agent_runs_as_the_unit_says() {
    let unit = unit();
    let options = setting(&unit, "Environment").replace("OPTIONS=", "");
    let start = setting(&unit, "ExecStart").replace("$OPTIONS", &options);
    let dir = scratch("agent");
    let path = dir.join("state.json");
    let start = start
        .replace("/run/replenish-agent/state.json", path.to_str().unwrap())
        .replace(":8888", ":0");
    let mut words = start.split_whitespace();
    assert_eq!(words.next(), Some("/usr/local/bin/replenish"));
    let mut agent = Command::new(BIN)
        .args(words)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It says so once it takes signals.
    let mut output = BufReader::new(agent.stdout.take().unwrap());
    let mut line = String::new();
    output.read_line(&mut line).unwrap();
    assert!(line.contains("listening"), "{line}");
    let signal = |name: &str| {
        let pid = agent.id().to_string();
        let kill = Command::new("kill").args(["-s", name, &pid]).status();
        assert!(kill.unwrap().success());
    };
    signal("USR1");
    let deadline = Instant::now() + Duration::from_secs(30);
    while !path.exists() {
        assert!(Instant::now() < deadline, "no JSON");
        std::thread::sleep(Duration::from_millis(20));
    }
    signal("TERM");
    let ended = agent.wait_with_output().unwrap();
    assert!(ended.status.success(), "{}", stderr(&ended));
    let state = json(&path);
    assert_eq!(state["bridge"], serde_json::Value::Null);
    assert!(state["clients"].is_array());
    std::fs::remove_dir_all(dir).ok();
}

//! Eclipse Cyclone DDS (C, through Python) in the place of a ROS 2 node with `rmw_cyclonedds`:
//! `tests/peers/setup.sh` installs it.
#![allow(clippy::unwrap_used, reason = "test code")]
#![allow(dead_code, reason = "every test binary uses its own part")]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// The script of the agent's tests, which other crates run as well.
const SCRIPT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../replenish-agent/tests/peers/cyclone.py"
);

/// The missing part, and the way to get it.
pub(crate) fn missing() -> Option<String> {
    let python = python();
    (!python.exists()).then(|| {
        let script = "crates/replenish-agent/tests/peers/setup.sh";
        format!("no {}: run {script}", python.display())
    })
}

fn python() -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let dir = std::env::var_os("CARGO_TARGET_DIR").map_or(target.to_path_buf(), PathBuf::from);
    // A relative one is meant from the workspace's root.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.join(dir).join("peers/cyclonedds/bin/python")
}

/// The foreign program, with a lease of 2 s. Ends with this.
pub(crate) struct Cyclone {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl Cyclone {
    pub(crate) fn start(domain: u16, arguments: &[&str]) -> Self {
        let (mode, rest) = arguments.split_first().unwrap();
        let mut child = Command::new(python())
            .args([SCRIPT, mode, &domain.to_string()])
            .args(rest)
            .env("LEASE", "2")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let mut cyclone = Self { child, output };
        cyclone.says("ready");
        cyclone
    }

    /// Stops or continues all of its threads.
    pub(crate) fn signal(&self, signal: &str) {
        let kill = format!("kill -{signal} {}", self.child.id());
        let mut shell = Command::new("sh");
        assert!(shell.args(["-c", &kill]).status().unwrap().success());
    }

    pub(crate) fn says(&mut self, expected: &str) {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        assert_eq!(line.trim(), expected);
    }
}

impl Drop for Cyclone {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

//! A foreign ROS 2 program in Python beside a test. `crates/replenish-rtps/tests/peers/setup.sh`
//! installs the environments that it runs in.
#![allow(
    clippy::missing_panics_doc,
    clippy::unwrap_used,
    reason = "a helper of tests, whose failures are panics"
)]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};

/// The Python of an environment. `tmpdir` is the test's `env!("CARGO_TARGET_TMPDIR")`.
pub fn python(tmpdir: &str, environment: &str) -> PathBuf {
    let target = Path::new(tmpdir).parent().unwrap();
    let dir = std::env::var_os("CARGO_TARGET_DIR").map_or(target.to_path_buf(), PathBuf::from);
    // A relative one is meant from the workspace's root.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.join(dir)
        .join("peers")
        .join(environment)
        .join("bin/python")
}

/// The reason to skip a test, and the remedy: this Python does not exist.
pub fn missing(python: &Path) -> Option<String> {
    let script = "crates/replenish-rtps/tests/peers/setup.sh";
    (!python.exists()).then(|| format!("no {}: run {script}", python.display()))
}

/// A foreign program, which ends with this.
pub struct Peer {
    child: Child,
    /// The lines that it prints.
    pub lines: Receiver<String>,
}

impl Peer {
    /// Starts a program that finds others on this host alone, in `domain`.
    pub fn start(command: &mut Command, domain: u16) -> Self {
        let mut child = command
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (send, lines) = channel();
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if send.send(line).is_err() {
                    break;
                }
            }
        });
        Self { child, lines }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

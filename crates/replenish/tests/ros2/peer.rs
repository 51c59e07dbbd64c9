//! rclpy in a process of its own.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// How long a line may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(90);

fn python() -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let dir = std::env::var_os("CARGO_TARGET_DIR").map_or(target.to_path_buf(), PathBuf::from);
    // A relative one is meant from the workspace's root.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.join(dir).join("peers/rclpy/bin/python")
}

/// What is missing, and how to get it.
pub(crate) fn missing() -> Option<String> {
    let python = python();
    let script = "crates/replenish-rtps/tests/peers/setup.sh";
    (!python.exists()).then(|| format!("no {}: run {script}", python.display()))
}

/// The foreign program. It ends with this.
pub(crate) struct Peer {
    child: Child,
    lines: Receiver<String>,
}

impl Peer {
    pub(crate) fn start(domain: u16, args: &[&str]) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/peer.py");
        let mut child = Command::new(python())
            .arg(script)
            .args(args)
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

    /// The next line that it says.
    pub(crate) fn line(&self) -> String {
        self.lines.recv_timeout(PATIENCE).expect("another line")
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

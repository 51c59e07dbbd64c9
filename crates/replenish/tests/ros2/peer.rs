//! A foreign program in a process of its own.

use replenish_testkit::peer;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

/// The longest wait for a line on a busy machine.
const PATIENCE: Duration = Duration::from_secs(90);

/// A foreign implementation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Foreign {
    /// rclpy of ROS 2 Kilted.
    Kilted,
    /// rclpy of ROS 2 Jazzy.
    Jazzy,
    /// Cyclone DDS 11, from the package index.
    Cyclone11,
    /// Cyclone DDS 0.10, from Debian.
    Cyclone010,
    /// Fast DDS 2.9, from Debian.
    FastDds29,
}

impl Foreign {
    pub(crate) const ROS: [Self; 2] = [Self::Kilted, Self::Jazzy];
    pub(crate) const DDS: [Self; 3] = [Self::Cyclone11, Self::Cyclone010, Self::FastDds29];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Kilted => "kilted",
            Self::Jazzy => "jazzy",
            Self::Cyclone11 => "cyclone_11",
            Self::Cyclone010 => "cyclone_0_10",
            Self::FastDds29 => "fastdds_2_9",
        }
    }

    /// The interpreter or program, and the script that it runs.
    fn program(self) -> (PathBuf, Option<&'static str>) {
        let python = |environment| peer::python(env!("CARGO_TARGET_TMPDIR"), environment);
        let (here, debian) = (
            concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/peer.py"),
            python("debian"),
        );
        let cyclone = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/foreign/cyclone.py");
        match self {
            Self::Kilted | Self::Jazzy => (python(self.name()), Some(here)),
            Self::Cyclone11 => (python("cyclonedds"), Some(cyclone)),
            Self::Cyclone010 => (debian.with_file_name("cyclone"), None),
            Self::FastDds29 => (debian.with_file_name("fastdds"), None),
        }
    }

    /// The missing part, and how to get it.
    pub(crate) fn missing(self) -> Option<String> {
        peer::missing(&self.program().0)
    }
}

impl Foreign {
    /// As [`missing`](Self::missing), or the Python package that an older environment lacks.
    pub(crate) fn missing_package(self, package: &str) -> Option<String> {
        self.missing().or_else(|| {
            let mut python = Command::new(self.program().0);
            let import = format!("import {package}");
            let status = python.args(["-c", &import]).stderr(Stdio::null()).status();
            let there = status.is_ok_and(|status| status.success());
            let setup = "crates/replenish-rtps/tests/peers/setup.sh";
            (!there).then(|| format!("no {package} in {}: run {setup}", self.name()))
        })
    }
}

/// The foreign program. It ends with this.
pub(crate) struct Peer(peer::Peer);

impl Peer {
    pub(crate) fn start(foreign: Foreign, domain: u16, args: &[&str]) -> Self {
        let (program, script) = foreign.program();
        let mut command = Command::new(program);
        command.args(script).args(args);
        Self(peer::Peer::start(&mut command, domain))
    }

    /// Behind `command`, which starts it too.
    pub(crate) fn start_behind(mut command: Command, foreign: Foreign, args: &[&str]) -> Self {
        let (program, script) = foreign.program();
        command.arg("--").arg(program).args(script).args(args);
        Self::start_command(&mut command)
    }

    /// Whatever `command` starts.
    pub(crate) fn start_command(command: &mut Command) -> Self {
        Self(peer::Peer::start(command, 0))
    }

    /// The next line that it says.
    pub(crate) fn line(&self) -> String {
        self.0.lines.recv_timeout(PATIENCE).expect("another line")
    }

    /// The next line, if it says one in time.
    pub(crate) fn line_within(&self, time: Duration) -> Option<String> {
        self.0.lines.recv_timeout(time).ok()
    }
}

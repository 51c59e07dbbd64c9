//! rclpy in a process of its own.

use replenish_testkit::peer;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

/// How long a line may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(90);

/// A distribution of ROS 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Distro {
    Kilted,
    Jazzy,
}

impl Distro {
    pub(crate) const ALL: [Self; 2] = [Self::Kilted, Self::Jazzy];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Kilted => "kilted",
            Self::Jazzy => "jazzy",
        }
    }

    fn python(self) -> PathBuf {
        peer::python(env!("CARGO_TARGET_TMPDIR"), self.name())
    }

    /// The missing part, and how to get it.
    pub(crate) fn missing(self) -> Option<String> {
        peer::missing(&self.python())
    }
}

/// The foreign program. It ends with this.
pub(crate) struct Peer(peer::Peer);

impl Peer {
    pub(crate) fn start(distro: Distro, domain: u16, args: &[&str]) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/peer.py");
        let mut command = Command::new(distro.python());
        Self(peer::Peer::start(command.arg(script).args(args), domain))
    }

    /// The next line that it says.
    pub(crate) fn line(&self) -> String {
        self.0.lines.recv_timeout(PATIENCE).expect("another line")
    }
}

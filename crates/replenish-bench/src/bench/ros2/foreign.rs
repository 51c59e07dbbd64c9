//! The foreign programs: where `peers/setup.sh` has put them.

use replenish_cli::outcome::Failure;
use std::path::PathBuf;
use std::process::Command;

/// A foreign implementation at both ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Foreign {
    /// Cyclone DDS 0.10.2, from Debian.
    Cyclone,
    /// rcl with `rmw_fastrtps` and Fast DDS, from the wheels of ROS 2 Kilted.
    RclFastDds,
}

/// Builds them.
const SETUP: &str = "crates/replenish-bench/peers/setup.sh";
/// Set in CI: a peer that is missing is an error.
const REQUIRED: &str = "REPLENISH_REQUIRE_PEERS";

impl Foreign {
    /// The program and its arguments but for the role, or why there is none.
    pub(super) fn command(self) -> Result<Command, String> {
        let root = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or("target".into(), PathBuf::from);
        let peers = root.join(target).join("peers");
        let there = |path: PathBuf| {
            let missing = || format!("{} is missing: run {SETUP}", path.display());
            path.exists().then_some(&path).ok_or_else(missing)?;
            Ok::<_, String>(path)
        };
        match self {
            Self::Cyclone => Ok(Command::new(there(peers.join("bench/cyclone"))?)),
            Self::RclFastDds => {
                let library = there(peers.join("bench/rcl.so"))?;
                let mut command = Command::new(there(peers.join("kilted/bin/python"))?);
                command.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/peers/rcl.py"));
                command.arg(library);
                Ok(command)
            }
        }
    }
}

/// A peer is missing: an error if it is required, else a reason to leave its path out.
pub(super) fn left_out(path: &str, reason: &str, require: bool) -> Result<String, Failure> {
    let text = format!("{path} is left out: {reason}");
    if require || std::env::var_os(REQUIRED).is_some_and(|value| value != "0") {
        return Err(Failure::refused(text));
    }
    eprintln!("{text}");
    Ok(text)
}

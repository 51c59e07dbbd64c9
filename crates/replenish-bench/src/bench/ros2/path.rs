//! The ways of a sample that are compared.

use super::foreign::Foreign;
use std::fmt;

/// A way there and back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Path {
    /// Sockets that block.
    RawUdp,
    /// `replenish-rtps` alone, on one thread.
    Wire,
    /// Executor and worker with a budget at both ends.
    Executor,
    /// The same without shared memory.
    ExecutorUdp,
    /// Cyclone DDS at both ends.
    Cyclone,
    /// rcl and Fast DDS at both ends.
    RclFastdds,
}

impl Path {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::RawUdp => "raw-udp",
            Self::Wire => "wire",
            Self::Executor => "executor",
            Self::ExecutorUdp => "executor-udp",
            Self::Cyclone => "cyclone",
            Self::RclFastdds => "rcl-fastdds",
        }
    }

    pub(super) const fn foreign(self) -> Option<Foreign> {
        match self {
            Self::Cyclone => Some(Foreign::Cyclone),
            Self::RclFastdds => Some(Foreign::RclFastDds),
            _ => None,
        }
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

//! The place of a program's live file, and how the program gets it.
//!
//! ```text
//!   REPLENISH_LIVE = off ──────► none is recorded
//!   REPLENISH_LIVE = DIRECTORY ► there
//!   otherwise ─► beside the ledger's entries ─► /dev/shm/replenish-UID
//!                (where that is in memory)
//! ```

use replenish_os::live::{LiveFile, SharedMemory, account};
use std::path::{Path, PathBuf};
use std::string::String;
use std::vec::Vec;

/// The environment variable that names the directory, or is `off`.
pub(super) const VARIABLE: &str = "REPLENISH_LIVE";

/// The value of [`VARIABLE`].
pub(super) enum Wanted {
    Off,
    Here(PathBuf),
    Default,
}

pub(super) fn wanted() -> Wanted {
    match std::env::var_os(VARIABLE).filter(|v| !v.is_empty()) {
        None => Wanted::Default,
        Some(off) if off == "off" => Wanted::Off,
        Some(directory) => Wanted::Here(directory.into()),
    }
}

/// A file of `bytes` zeros in the first directory that takes one; or the reasons why none does.
pub(super) fn find(
    wanted: Wanted,
    ledger: Option<&Path>,
    bytes: usize,
) -> Result<(LiveFile, SharedMemory), String> {
    let directories = match wanted {
        Wanted::Here(named) => [Some(named), None],
        Wanted::Off | Wanted::Default => {
            let own = PathBuf::from(std::format!("/dev/shm/replenish-{}", account()));
            [ledger.map(Path::to_owned), Some(own)]
        }
    };
    let mut why = Vec::new();
    for directory in directories.into_iter().flatten() {
        match LiveFile::create(&directory, bytes) {
            Ok(found) => return Ok(found),
            Err(e) => why.push(std::format!("{}: {e}", directory.display())),
        }
    }
    Err(why.join("; "))
}

//! The directories in which programs and boards record.

use replenish_plan::ledger::{DEFAULT, Found, Ledger};
use std::path::{Path, PathBuf};

/// The environment variable by which programs choose their directory.
const VARIABLE: &str = "REPLENISH_LIVE";
/// The parent of the directories, one of each account, of recordings that have no other place.
const SHARED: &str = "/dev/shm";

/// The directory that is named, or every one in which programs of this host record.
pub(super) fn directories() -> Vec<PathBuf> {
    if let Some(named) = std::env::var_os(VARIABLE).filter(|v| !v.is_empty() && *v != *"off") {
        return vec![named.into()];
    }
    let mut all = vec![PathBuf::from(DEFAULT)];
    if let Ok(Found::Here(ledger)) = Ledger::look() {
        all.push(ledger.directory().into());
    }
    let shared = std::fs::read_dir(SHARED).into_iter().flatten().take(4096);
    let ours = |path: &Path| {
        let name = path.file_name().and_then(|n| n.to_str());
        name.is_some_and(|n| n.starts_with("replenish-")) && !path.is_symlink() && path.is_dir()
    };
    let shared = shared.flatten().map(|entry| entry.path());
    all.extend(shared.filter(|path| ours(path)));
    all.sort_unstable();
    all.dedup();
    all
}

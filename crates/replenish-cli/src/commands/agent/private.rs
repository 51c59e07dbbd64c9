//! Files with secrets: no account but their owner's and group's may have access.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Access of other accounts.
const OTHERS: u32 = 0o007;

/// Refuses a file with secrets that other accounts can read or change.
pub(super) fn check(path: &Path, found: &Metadata) -> Result<(), String> {
    let mode = found.mode() & 0o7777;
    if mode & OTHERS == 0 {
        return Ok(());
    }
    let path = shown(path);
    Err(format!(
        "its mode is {mode:04o}, with which every account has its secrets: allowed are modes without \
         access for others, as 0600 or 0640 (chmod o= {path})"
    ))
}

/// A path in a message, without characters that could rule a terminal.
pub(super) fn shown(path: &Path) -> String {
    path.display().to_string().escape_debug().to_string()
}

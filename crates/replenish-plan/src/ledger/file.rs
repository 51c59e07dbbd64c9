//! The entries: read, added and removed.

use super::entry::{LedgerEntry, MAX_BYTES};
use super::error::LedgerError;
use super::lock;
use super::open::{create, open_plain};
use std::fs::{self, File, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// The environment variable that names the directory of the ledger, or is `off`.
pub const VARIABLE: &str = "REPLENISH_LEDGER";

/// More live entries are refused.
const MAX_ENTRIES: usize = 1024;
/// More files are not looked at.
const MAX_FILES: usize = 8192;

/// A program's place in the ledger. Dropping it gives it back.
#[derive(Debug)]
pub struct Reservation {
    path: PathBuf,
    /// Holds the lock that makes the entry count.
    _file: File,
}

impl Reservation {
    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        // If it cannot be removed, it counts for nothing without its lock all the same.
        fs::remove_file(&self.path).ok();
    }
}

/// Every entry that counts, in the order of their names, and what is wrong with the others. `tidy`
/// removes what the dead left behind; it needs the directory's lock.
pub(super) fn read_all(
    directory: &Path,
    tidy: bool,
) -> Result<(Vec<LedgerEntry>, Vec<LedgerError>), LedgerError> {
    let unreadable = |e: &io::Error| LedgerError::new(directory, e.to_string());
    let mut paths = Vec::new();
    for (count, found) in fs::read_dir(directory)
        .map_err(|e| unreadable(&e))?
        .enumerate()
    {
        let path = found.map_err(|e| unreadable(&e))?.path();
        if count >= MAX_FILES {
            let reason = format!("more than {MAX_FILES} files");
            return Err(LedgerError::new(directory, reason));
        }
        if path.extension().is_some_and(|e| e == "entry" || e == "new") {
            paths.push(path);
        }
    }
    paths.sort_unstable();
    let (mut entries, mut wrong) = (Vec::new(), Vec::new());
    for path in paths {
        match read_live(&path, tidy) {
            Ok(None) => {}
            Ok(Some(entry)) => entries.push(entry),
            Err(reason) => wrong.push(LedgerError::new(&path, reason)),
        }
        if entries.len() > MAX_ENTRIES {
            let reason = format!("more than {MAX_ENTRIES} programs have reservations");
            return Err(LedgerError::new(directory, reason));
        }
    }
    Ok((entries, wrong))
}

fn is_new(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "new")
}

/// `None` if its owner has gone; `tidy` removes it then.
fn read_live(path: &Path, tidy: bool) -> Result<Option<LedgerEntry>, String> {
    let file = match open_plain(path) {
        Ok(file) => file,
        // Its owner has just given it back.
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        // Not complete. Where this program has the lock, its owner has died over it.
        Err(e) if e.kind() == io::ErrorKind::PermissionDenied && is_new(path) => {
            if tidy {
                fs::remove_file(path).ok();
            }
            return Ok(None);
        }
        Err(e) => return Err(e.to_string()),
    };
    if !lock::is_owned(&file).map_err(|e| e.to_string())? {
        if tidy {
            // It may belong to another account: then it stays, and counts for nothing.
            fs::remove_file(path).ok();
        }
        return Ok(None);
    }
    if is_new(path) {
        return Err("it is locked, but was not completed".into());
    }
    let mut text = String::new();
    let mut limited = (&file).take(MAX_BYTES + 1);
    limited
        .read_to_string(&mut text)
        .map_err(|e| e.to_string())?;
    if text.len() as u64 > MAX_BYTES {
        return Err(format!("it is longer than {MAX_BYTES} bytes"));
    }
    LedgerEntry::read(&text).map(Some)
}

/// Adds an entry. To be called with the lock held.
pub(super) fn add(directory: &Path, entry: &LedgerEntry) -> Result<Reservation, LedgerError> {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let name = format!("{:032x}", since.map_or(0, |d| d.as_nanos()));
    let (file, path) = put(directory, &name, ".entry", entry.write().as_bytes()).map_err(|e| {
        let reason = format!(
            "nothing can be reserved here: {e} (who may write to it may reserve; {VARIABLE} names another directory, or is off)"
        );
        LedgerError::new(directory, reason)
    })?;
    Ok(Reservation { path, _file: file })
}

/// Writes a file that appears whole: under a new name, locked, then renamed to `name`, a number if
/// it has a `suffix`, and that. No file that is there is opened, and no link followed.
///
/// Until it is complete no other account can open it, so no foreign lock can be in the way.
pub(super) fn put(
    directory: &Path,
    name: &str,
    suffix: &str,
    text: &[u8],
) -> io::Result<(File, PathBuf)> {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    loop {
        let next = NEXT.fetch_add(1, Ordering::Relaxed);
        let unique = format!("{name}-{}-{next}", std::process::id());
        let new = directory.join(format!("{unique}.new"));
        let path = match suffix {
            "" => directory.join(name),
            _ => directory.join(format!("{unique}{suffix}")),
        };
        let mut file = match create(&new) {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            Err(e) => return Err(e),
        };
        let written = lock::own(&file)
            .and_then(|()| file.write_all(text))
            .and_then(|()| file.set_permissions(Permissions::from_mode(0o644)))
            .and_then(|()| fs::rename(&new, &path));
        return match written {
            Ok(()) => Ok((file, path)),
            Err(e) => {
                fs::remove_file(&new).ok();
                Err(e)
            }
        };
    }
}

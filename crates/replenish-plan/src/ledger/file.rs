//! The files: opening, locking, adding and removing.

use super::entry::{LedgerEntry, MAX_BYTES};
use super::error::LedgerError;
use std::fs::{self, File, OpenOptions, Permissions, TryLockError};
use std::io::{self, Read, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
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

/// Opens the file that is locked during admission; whoever may read it may lock it.
pub(super) fn open_lock(path: &Path) -> io::Result<File> {
    let made = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o644)
        .open(path);
    match made {
        Ok(file) => {
            file.set_permissions(Permissions::from_mode(0o644))?;
            Ok(file)
        }
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => open_plain(path),
        Err(e) => Err(e),
    }
}

/// Opens an ordinary file for reading: no link is followed, no pipe is waited for.
pub(super) fn open_plain(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)?;
    if file.metadata()?.is_file() {
        Ok(file)
    } else {
        Err(io::Error::other("it is not an ordinary file"))
    }
}

/// Every entry that counts, in the order of their names, and what is wrong with the others. To be
/// called with the lock held.
pub(super) fn read_all(
    directory: &Path,
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
        match read_live(&path) {
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

/// `None` if its owner has gone; it is removed then.
fn read_live(path: &Path) -> Result<Option<LedgerEntry>, String> {
    let file = match open_plain(path) {
        Ok(file) => file,
        // Its owner has just given it back.
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e.to_string()),
    };
    match file.try_lock() {
        Ok(()) => {
            // Perhaps somebody else's: then it stays, and counts for nothing.
            fs::remove_file(path).ok();
            return Ok(None);
        }
        Err(TryLockError::WouldBlock) => {}
        Err(TryLockError::Error(e)) => return Err(e.to_string()),
    }
    if path.extension().is_some_and(|e| e == "new") {
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
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let text = entry.write();
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let since = since.map_or(0, |d| d.as_nanos());
    loop {
        let next = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("{since:032x}-{next}");
        let (new, path) = (
            directory.join(format!("{name}.new")),
            directory.join(format!("{name}.entry")),
        );
        let made = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o644)
            .open(&new);
        let wrong = |e: io::Error| {
            fs::remove_file(&new).ok();
            LedgerError::new(
                directory,
                format!(
                    "nothing can be reserved here: {e} (who may write to it may reserve; {VARIABLE} names another directory, or is off)"
                ),
            )
        };
        let mut file = match made {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            Err(e) => return Err(wrong(e)),
        };
        file.set_permissions(Permissions::from_mode(0o644))
            .map_err(wrong)?;
        file.try_lock().map_err(|e| wrong(e.into()))?;
        file.write_all(text.as_bytes()).map_err(wrong)?;
        fs::rename(&new, &path).map_err(wrong)?;
        return Ok(Reservation { path, _file: file });
    }
}

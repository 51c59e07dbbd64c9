//! The file in which a program records, beside those of others.
//!
//! A file of a program that lives is locked. Files of the dead stay for a search of the cause, the
//! newest [`DEAD`] of them.

use super::live::{SharedMemory, account, create, is_in_memory, open_plain};
use std::ffi::OsStr;
use std::fs::{DirBuilder, File, Permissions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::string::ToString;
use std::vec::Vec;

/// The most files of ended programs that a directory keeps.
const DEAD: usize = 8;
/// More files are not looked at.
const MAX_FILES: usize = 4096;

/// A file in a directory of recordings; removed when dropped.
#[derive(Debug)]
pub struct LiveFile {
    path: PathBuf,
    /// Holds the lock by which others see that the program lives.
    _file: File,
}

impl LiveFile {
    /// Makes a file `PID-NUMBER.live` of `bytes` zeros in `directory`, which is made, too, if it is
    /// not there. Of the files of programs that have ended, the newest eight stay.
    ///
    /// # Errors
    /// If the directory is a stranger's, lies on a disk or has no room.
    pub fn create(directory: &Path, bytes: usize) -> io::Result<(Self, SharedMemory)> {
        open_directory(directory)?;
        put(directory, bytes)
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The program, or the board, has ended without a word: the file stays, and says so.
    pub fn leave(mut self) {
        self.path = PathBuf::new();
    }
}

impl Drop for LiveFile {
    fn drop(&mut self) {
        if !self.path.as_os_str().is_empty() {
            std::fs::remove_file(&self.path).ok(); // the next program sweeps
        }
    }
}

/// Makes a directory of recordings if it is not there.
///
/// # Errors
/// If it cannot be made, or is a stranger's.
pub fn open_directory(directory: &Path) -> io::Result<()> {
    match DirBuilder::new().mode(0o750).create(directory) {
        Ok(()) => return Ok(()),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
        Err(e) => return Err(e),
    }
    let facts = std::fs::symlink_metadata(directory)?;
    let trusted = facts.uid() == account() || facts.uid() == 0;
    if facts.is_dir() && trusted {
        return Ok(());
    }
    Err(io::Error::other("it is no directory of this account"))
}

fn put(directory: &Path, bytes: usize) -> io::Result<(LiveFile, SharedMemory)> {
    sweep(directory);
    let pid = std::process::id();
    for n in 0..1024 {
        let path = directory.join(format!("{pid}-{n}.live"));
        let mut file = match create(&path) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            created => created?,
        };
        let place = LiveFile {
            path,
            _file: file.try_clone()?,
        };
        // No other process can open the file yet, so none can hold its lock.
        file.try_lock()
            .map_err(|e| io::Error::other(e.to_string()))?;
        if !is_in_memory(&file)? {
            return Err(io::Error::other(
                "it is on a disk, which would hold up threads",
            ));
        }
        // Written, not made longer: memory that there is not is refused here, not by a signal.
        let zeros = [0; 16 << 10];
        let mut left = bytes;
        while left > 0 {
            let some = zeros.get(..left.min(zeros.len())).unwrap_or(&zeros);
            file.write_all(some)?;
            left -= some.len();
        }
        let memory = SharedMemory::of_file(&file, bytes)?;
        file.set_permissions(Permissions::from_mode(0o640))?;
        return Ok((place, memory));
    }
    Err(io::Error::other("this process has 1024 files there"))
}

/// Removes files of programs that have ended, but for the newest.
fn sweep(directory: &Path) {
    let Ok(entries) = std::fs::read_dir(directory) else {
        return;
    };
    let mut dead = Vec::new();
    for path in entries.take(MAX_FILES).flatten().map(|entry| entry.path()) {
        if path.extension() != Some(OsStr::new("live")) {
            continue;
        }
        let Ok(file) = open_plain(&path) else {
            continue; // another account's, or not complete
        };
        let alive = matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock));
        if let (false, Ok(facts)) = (alive, file.metadata()) {
            dead.push(((facts.mtime(), facts.mtime_nsec()), path));
        }
    }
    dead.sort_unstable_by(|a, b| b.cmp(a));
    for (_, path) in dead.iter().skip(DEAD) {
        std::fs::remove_file(path).ok(); // another account's stays
    }
}

//! Where a program's file stands, and how it gets there.
//!
//! ```text
//!   REPLENISH_LIVE = off ──────► none is recorded
//!   REPLENISH_LIVE = DIRECTORY ► there
//!   otherwise ─► beside the ledger's entries ─► /dev/shm/replenish-UID
//!                (where that is in memory)
//! ```
//!
//! A file of a program that lives is locked. Files of the dead stay for whoever looks for the
//! cause, the newest [`DEAD`] of them.

use replenish_os::live::{self, SharedMemory, account, is_in_memory};
use std::ffi::OsStr;
use std::fs::{DirBuilder, File, Permissions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// The environment variable that names the directory, or is `off`.
pub(super) const VARIABLE: &str = "REPLENISH_LIVE";
/// So many files of programs that have ended are kept in a directory.
const DEAD: usize = 8;
/// More files are not looked at.
const MAX_FILES: usize = 4096;

/// A file with its map; removed when dropped.
#[derive(Debug)]
pub(super) struct Place {
    path: PathBuf,
    /// Holds the lock by which others see that the program lives.
    _file: File,
}

impl Drop for Place {
    fn drop(&mut self) {
        std::fs::remove_file(&self.path).ok(); // the next program sweeps
    }
}

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

/// A file of so many zeros in the first directory that takes one; or the reasons why none does.
pub(super) fn find(
    wanted: Wanted,
    ledger: Option<&Path>,
    bytes: usize,
) -> Result<(Place, SharedMemory), String> {
    let directories = match wanted {
        Wanted::Here(named) => [Some(named), None],
        Wanted::Off | Wanted::Default => {
            let own = PathBuf::from(std::format!("/dev/shm/replenish-{}", account()));
            [ledger.map(Path::to_owned), Some(own)]
        }
    };
    let mut why = Vec::new();
    for directory in directories.into_iter().flatten() {
        match open(&directory).and_then(|()| put(&directory, bytes)) {
            Ok(found) => return Ok(found),
            Err(e) => why.push(std::format!("{}: {e}", directory.display())),
        }
    }
    Err(why.join("; "))
}

/// The directory is there, and no stranger's.
fn open(directory: &Path) -> io::Result<()> {
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

fn put(directory: &Path, bytes: usize) -> io::Result<(Place, SharedMemory)> {
    sweep(directory);
    let pid = std::process::id();
    for n in 0..1024 {
        let path = directory.join(std::format!("{pid}-{n}.live"));
        let mut file = match live::create(&path) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            created => created?,
        };
        let place = Place {
            path,
            _file: file.try_clone()?,
        };
        // Nobody else can open it yet: so nobody else's lock is in the way.
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
        let Ok(file) = live::open_plain(&path) else {
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

//! The two locks of the ledger, neither of which a stranger can take.
//!
//! ```text
//!   the directory's   flock on `lock`, which only those can open who may write to the directory
//!   an entry's        a write lock on its first byte (`F_OFD_SETLK`), for which the kernel asks a
//!                     descriptor that may write: only the owner's account can have one
//! ```
//!
//! Any account may read an entry, so it may hold read locks and `flock` on it, or wait for one
//! until its owner ends. Neither says that the owner lives: only a write lock does.

use super::error::LedgerError;
use super::open as plain;
use nix::fcntl::{FcntlArg, fcntl};
use std::fs::{File, Metadata, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
use std::path::Path;
use std::time::{Duration, Instant};

/// The longest wait of an admission for another one to finish.
const PATIENCE: Duration = Duration::from_secs(10);

/// Takes the lock of `directory`. `None`: this account may not reserve here, so it cannot have it.
pub(super) fn take(directory: &Path) -> Result<Option<File>, LedgerError> {
    let path = directory.join("lock");
    let wrong = |e: &io::Error| LedgerError::new(&path, e.to_string());
    let file = match open(directory, &path) {
        Ok(file) => file,
        Err(e) if is_forbidden(&e) => return Ok(None),
        Err(e) => return Err(wrong(&e)),
    };
    let start = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(Some(file)),
            Err(std::fs::TryLockError::Error(e)) => return Err(wrong(&e)),
            Err(std::fs::TryLockError::WouldBlock) if start.elapsed() > PATIENCE => {
                let seconds = PATIENCE.as_secs();
                let why = format!("a program that may reserve has kept it locked for {seconds} s");
                return Err(LedgerError::new(&path, why));
            }
            Err(std::fs::TryLockError::WouldBlock) => {
                std::thread::sleep(Duration::from_millis(2));
            }
        }
    }
}

fn is_forbidden(error: &io::Error) -> bool {
    let kind = error.kind();
    kind == io::ErrorKind::PermissionDenied || kind == io::ErrorKind::ReadOnlyFilesystem
}

/// Opens the lock's file, and creates it if there is none.
fn open(directory: &Path, path: &Path) -> io::Result<File> {
    let place = directory.metadata()?;
    let file = match plain::open_plain(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            create(directory, &place, path)?;
            plain::open_plain(path)?
        }
        other => other?,
    };
    // One that strangers may open, too, was made by hand or by an older version. A file with
    // another name besides is not the ledger's to change.
    let facts = file.metadata()?;
    let tight = facts.mode() & (members(&place) | !0o777);
    if tight != facts.mode() && facts.nlink() == 1 {
        file.set_permissions(Permissions::from_mode(tight & 0o7777))
            .ok();
    }
    Ok(file)
}

/// Creates the lock's file with its owner, group and mode; it may be there by then.
fn create(directory: &Path, place: &Metadata, path: &Path) -> io::Result<()> {
    let new = directory.join(format!("lock-{}.new", std::process::id()));
    let file = match plain::create(&new) {
        Ok(file) => file,
        // Another thread of this program is at it, or a dead one was.
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
            std::thread::sleep(Duration::from_millis(20));
            if path.exists() {
                return Ok(());
            }
            std::fs::remove_file(&new)?;
            plain::create(&new)?
        }
        Err(e) => return Err(e),
    };
    // Root's ledger may be another account's directory.
    fchown(&file, Some(place.uid()), None).ok();
    let same = fchown(&file, None, Some(place.gid())).is_ok();
    let group = if same { 0o777 } else { 0o707 };
    let linked = file
        .set_permissions(Permissions::from_mode(members(place) & group))
        .and_then(|()| std::fs::hard_link(&new, path));
    std::fs::remove_file(&new).ok();
    match linked {
        // Gone: a program that has the lock by now has tidied up.
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(e) if e.kind() == io::ErrorKind::NotFound && path.exists() => Ok(()),
        other => other,
    }
}

/// Read and write permission for the accounts that may write to the directory.
fn members(directory: &Metadata) -> u32 {
    let all = [(0o200, 0o600), (0o020, 0o060), (0o002, 0o006)];
    let may = all
        .iter()
        .filter(|(write, _)| directory.mode() & write != 0);
    may.fold(0o600, |mode, (_, bits)| mode | bits)
}

/// Locks an entry for as long as `file` is open, here or in a forked child.
pub(super) fn own(file: &File) -> io::Result<()> {
    let lock = range(libc::F_WRLCK);
    fcntl(file, FcntlArg::F_OFD_SETLK(&lock))?;
    Ok(())
}

/// Whether a program holds the lock of [`own`].
pub(super) fn is_owned(file: &File) -> io::Result<bool> {
    let mut lock = range(libc::F_RDLCK);
    fcntl(file, FcntlArg::F_OFD_GETLK(&mut lock))?;
    Ok(i32::from(lock.l_type) == libc::F_WRLCK)
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "constants that fit, of types that differ between C libraries"
)]
const fn range(kind: libc::c_int) -> libc::flock {
    libc::flock {
        l_type: kind as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 1,
        l_pid: 0,
    }
}

//! One real-time run at a time on this machine.
//!
//! Two runs that keep a CPU busy at real-time priority would measure each other. The lock file
//! is the one that the project's tests use.

use crate::outcome::Failure;
use std::fs::{File, OpenOptions, TryLockError};

/// Held for as long as a run lasts; closing the file releases the lock.
#[derive(Debug)]
pub struct RunLock(#[expect(dead_code, reason = "closing the file releases the lock")] File);

/// Waits until no other real-time run is in progress; says so if it has to wait.
///
/// # Errors
/// The lock file cannot be opened or locked.
pub fn acquire() -> Result<RunLock, Failure> {
    let path = std::env::temp_dir().join("replenish-rt.lock");
    let failed = |e: std::io::Error| Failure::refused(format!("{}: {e}", path.display()));
    let file = OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        // Another user made the file: a read-only descriptor can be locked just as well.
        .or_else(|_| OpenOptions::new().read(true).open(&path))
        .map_err(failed)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            remark!(
                "waiting for another real-time run on this machine ({})",
                path.display()
            );
            file.lock().map_err(failed)?;
        }
        Err(TryLockError::Error(e)) => return Err(failed(e)),
    }
    Ok(RunLock(file))
}

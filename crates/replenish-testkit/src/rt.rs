//! Real-time privilege in tests: the probe, the machine-wide lock, the rule for skipping.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsRawFd;

/// Name of the variable that turns every "real-time priority is missing" skip into a failure.
///
/// `.ci/run` sets it, so that CI can never turn green by skipping.
pub const REQUIRE: &str = "REPLENISH_REQUIRE_RT";

/// Whether skips are failures in this run ([`REQUIRE`] is set and not empty or `0`).
#[must_use]
pub fn required() -> bool {
    std::env::var_os(REQUIRE).is_some_and(|v| !v.is_empty() && v != "0")
}

/// Whether this process may use `SCHED_FIFO`; probed on a thread of its own.
///
/// # Errors
/// The sentence to print beside a skipped test.
pub fn available() -> Result<(), String> {
    let probe = std::thread::spawn(|| {
        let param = libc::sched_param { sched_priority: 1 };
        // SAFETY: `param` is a valid sched_param that outlives the call; pid 0 is this thread.
        #[expect(unsafe_code, reason = "the probe asks the kernel itself")]
        let rc = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const param) };
        if rc == 0 {
            Ok(())
        } else {
            Err(io::Error::last_os_error())
        }
    });
    match probe.join() {
        Ok(Ok(())) => Ok(()),
        Ok(Err(e)) => Err(format!("SCHED_FIFO is not granted here ({e})")),
        Err(_) => Err("the probe thread panicked".into()),
    }
}

/// Holds the machine-wide lock for real-time tests and benchmarks until dropped.
#[derive(Debug)]
pub struct RtLock(#[expect(dead_code, reason = "closing the file releases the lock")] File);

/// Waits for the machine-wide lock: across threads, test binaries and checkouts.
///
/// # Errors
/// When the lock file in the temporary directory cannot be opened or locked.
pub fn lock() -> io::Result<RtLock> {
    let path = std::env::temp_dir().join("replenish-rt.lock");
    let file = OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        .or_else(
            // Another user made the file: a read-only descriptor can be locked just as well.
            |_| OpenOptions::new().read(true).open(&path),
        )?;
    loop {
        // SAFETY: the descriptor is open for as long as `file` lives.
        #[expect(unsafe_code, reason = "flock has no safe wrapper in std")]
        let rc = unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_EX) };
        if rc == 0 {
            return Ok(RtLock(file));
        }
        let e = io::Error::last_os_error();
        if e.kind() != io::ErrorKind::Interrupted {
            return Err(e);
        }
    }
}

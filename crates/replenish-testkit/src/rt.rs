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
    let probe = std::thread::spawn(|| fifo(1));
    match probe.join() {
        Ok(Ok(())) => Ok(()),
        Ok(Err(e)) => Err(format!("SCHED_FIFO is not granted here ({e})")),
        Err(_) => Err("the probe thread panicked".into()),
    }
}

/// Makes the calling thread `SCHED_FIFO`.
///
/// # Errors
/// The errors of `sched_setscheduler(2)`.
pub(crate) fn fifo(sched_priority: i32) -> io::Result<()> {
    let param = libc::sched_param { sched_priority };
    // SAFETY: `param` is a valid sched_param that outlives the call; pid 0 is this thread.
    #[expect(unsafe_code, reason = "the probe asks the kernel itself")]
    let rc = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const param) };
    said(rc)
}

/// The CPUs that the calling thread may use; none if the kernel does not say.
#[expect(unsafe_code, reason = "sched_getaffinity has no safe wrapper in std")]
pub(crate) fn cpus() -> Vec<usize> {
    // SAFETY: an all-zero set is valid, and empty.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    let bytes = size_of_val(&set);
    // SAFETY: `set` is valid for writing `bytes`; pid 0 is this thread.
    if unsafe { libc::sched_getaffinity(0, bytes, &raw mut set) } != 0 {
        return Vec::new();
    }
    // SAFETY: the number of the CPU is below the size of the set.
    let has = |cpu: &usize| unsafe { libc::CPU_ISSET(*cpu, &set) };
    (0..bytes * 8).filter(has).collect()
}

/// Pins the calling thread to `cpu`, one of [`cpus`].
///
/// # Errors
/// The errors of `sched_setaffinity(2)`.
#[expect(unsafe_code, reason = "sched_setaffinity has no safe wrapper in std")]
pub(crate) fn pin(cpu: usize) -> io::Result<()> {
    // SAFETY: an all-zero set is valid, and empty.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    // SAFETY: the caller's number comes from such a set.
    unsafe { libc::CPU_SET(cpu, &mut set) };
    // SAFETY: `set` is valid for reading; pid 0 is this thread.
    said(unsafe { libc::sched_setaffinity(0, size_of_val(&set), &raw const set) })
}

fn said(rc: libc::c_int) -> io::Result<()> {
    if rc == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
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

//! A program that gives up its privileges while it runs; tests and `replenish bench torture` do it.
#![expect(unsafe_code, reason = "setuid for all threads of the process")]

use super::sys;
use std::io;

/// The whole process goes on as this user. A thread that does not get the CPU holds this up.
///
/// # Errors
/// `EPERM` without the privilege.
pub fn become_user(id: u32) -> io::Result<()> {
    // SAFETY: a plain number; the C library changes all threads of the process.
    sys::check(unsafe { libc::setuid(id) }).map(drop)
}

//! A real signal handler, for what claims to be callable from one.
#![expect(unsafe_code, reason = "sigaction is a system call")]

use std::io;
use std::sync::OnceLock;

type Action = Box<dyn Fn() + Send + Sync>;

static ACTION: OnceLock<Action> = OnceLock::new();

extern "C" fn handler(_signal: libc::c_int) {
    if let Some(action) = ACTION.get() {
        action();
    }
}

/// Runs `action` in the handler of `SIGUSR1` from now on, on whichever thread gets the signal.
/// Once per process: the first action stays.
///
/// `action` must be async-signal-safe (POSIX.1-2017, XSH 2.4.3): no lock, no allocation. That is
/// what the test is about; the type system cannot see it.
///
/// # Errors
/// The errors of `sigaction`.
pub fn on_user_signal(action: impl Fn() + Send + Sync + 'static) -> io::Result<()> {
    ACTION.set(Box::new(action)).ok();
    let entry: extern "C" fn(libc::c_int) = handler;
    // SAFETY: an all-zero sigaction is valid: no flags, an empty mask, the default action.
    let mut new: libc::sigaction = unsafe { core::mem::zeroed() };
    new.sa_sigaction = entry as libc::sighandler_t;
    // SAFETY: `new` is initialised and outlives the call; no old action is asked for.
    match unsafe { libc::sigaction(libc::SIGUSR1, &raw const new, core::ptr::null_mut()) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Sends `SIGUSR1` to the calling thread: its handler has run when this returns.
pub fn raise_user_signal() {
    // SAFETY: the signal has a handler or ends the process; no memory is involved.
    unsafe { libc::raise(libc::SIGUSR1) };
}

//! A process to which signals are sent, and never to another one of the same number; and the user
//! at the other end of a local socket.

use crate::Tid;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::io;
use std::os::fd::{AsFd, OwnedFd};

/// A running process (`pidfd_open(2)`).
#[derive(Debug)]
pub struct Process(OwnedFd);

impl Process {
    /// The process of that number at this moment.
    ///
    /// # Errors
    /// `ESRCH` if there is none, `EINVAL` for a thread that is not a process's first one, `ENOSYS`
    /// before Linux 5.3.
    pub fn open(pid: Tid) -> io::Result<Self> {
        let pid = Pid::from_raw(pid.get()).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(Self(pidfd_open(pid, PidfdFlags::empty())?))
    }

    /// Sends signal `number`.
    ///
    /// # Errors
    /// `ESRCH` if the process has ended, `EPERM` for another user's, `EINVAL` for a number that is
    /// not one of the named signals.
    pub fn signal(&self, number: i32) -> io::Result<()> {
        let signal = Signal::from_named_raw(number).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(pidfd_send_signal(&self.0, signal)?)
    }
}

/// The user whose process made the other end of a connected Unix socket (`SO_PEERCRED`).
///
/// # Errors
/// `ENOTCONN`, or `ENOPROTOOPT` for another kind of socket.
pub fn peer_user(socket: &impl AsFd) -> io::Result<u32> {
    Ok(rustix::net::sockopt::socket_peercred(socket)?.uid.as_raw())
}

/// The user that this process acts for.
#[must_use]
pub fn user() -> u32 {
    rustix::process::geteuid().as_raw()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixStream;
    use std::os::unix::process::ExitStatusExt;
    use std::process::Command;

    #[test]
    fn a_process_that_has_ended_gets_no_signal() {
        let mut child = Command::new("sleep").arg("60").spawn().unwrap();
        let process = Process::open(Tid::new(child.id().cast_signed()).unwrap()).unwrap();
        assert!(process.signal(0).is_err());
        process.signal(libc::SIGTERM).unwrap();
        assert_eq!(child.wait().unwrap().signal(), Some(libc::SIGTERM));
        let gone = process.signal(libc::SIGTERM).unwrap_err();
        assert_eq!(gone.raw_os_error(), Some(libc::ESRCH));
    }

    #[test]
    fn both_ends_of_a_pair_are_this_user() {
        let (a, b) = UnixStream::pair().unwrap();
        assert_eq!(peer_user(&a).unwrap(), user());
        assert_eq!(peer_user(&b).unwrap(), user());
    }
}

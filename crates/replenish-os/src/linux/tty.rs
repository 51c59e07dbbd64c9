//! Serial lines: opening one raw at a baud rate, and pairs of pseudo-terminals to try that without
//! one.

use super::sys;
use rustix::pty::{ptsname, unlockpt};
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr,
};
use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

const RATES: [u32; 18] = [
    1_200, 2_400, 4_800, 9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 500_000,
    576_000, 921_600, 1_000_000, 1_500_000, 2_000_000, 3_000_000, 4_000_000,
];

/// The baud rates that [`Tty::open`] knows.
pub fn baud_rates() -> impl Iterator<Item = u32> {
    RATES.into_iter()
}

/// An open serial line: raw, 8 data bits, no parity, one stop bit, no flow control. Reading and
/// writing never wait: without data or room they fail with [`io::ErrorKind::WouldBlock`].
#[derive(Debug)]
pub struct Tty(File);

impl Tty {
    /// Opens the terminal at `path`, which does not become the controlling one. Bytes that
    /// had arrived before are dropped.
    ///
    /// # Errors
    /// `InvalidInput` for a rate that is not among [`baud_rates`]; `ENOTTY` if `path` is not a
    /// terminal; what `open(2)` says.
    pub fn open(path: &Path, baud: u32) -> io::Result<Self> {
        if !RATES.contains(&baud) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("no baud rate of terminals: {baud}"),
            ));
        }
        let file = open(path)?;
        make_raw(&file, baud)?;
        Ok(Self(file))
    }

    /// Reads what is there.
    ///
    /// # Errors
    /// `WouldBlock` if nothing is; `EIO` when the other side of a pseudo-terminal or an adapter is
    /// gone. 0 bytes mean the same.
    pub fn read(&self, buf: &mut [u8]) -> io::Result<usize> {
        sys::retry(|| (&self.0).read(buf))
    }

    /// Writes as much as there is room for.
    ///
    /// # Errors
    /// `WouldBlock` if there is none; `EIO` as for [`read`](Self::read).
    pub fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        sys::retry(|| (&self.0).write(bytes))
    }
}

impl AsFd for Tty {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// One side of a pair of pseudo-terminals; the other is the terminal at [`path`](Self::path).
/// When this side is dropped the other sees its line go dead.
#[derive(Debug)]
pub struct Pty {
    /// This side; not waiting, like every [`Tty`].
    pub tty: Tty,
    path: PathBuf,
}

impl Pty {
    /// A new pair, raw from the beginning.
    ///
    /// # Errors
    /// `EMFILE`, `ENFILE`, `ENOSPC` when there are no more.
    pub fn open() -> io::Result<Self> {
        let file = open(Path::new("/dev/ptmx"))?;
        unlockpt(&file)?;
        let name = ptsname(&file, Vec::new())?;
        make_raw(&file, 115_200)?;
        Ok(Self {
            tty: Tty(file),
            path: OsString::from_vec(name.into_bytes()).into(),
        })
    }

    /// The terminal at the other end.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(libc::O_NOCTTY | libc::O_NONBLOCK)
        .open(path)
}

fn make_raw(file: &File, baud: u32) -> io::Result<()> {
    let mut line = tcgetattr(file)?;
    line.make_raw();
    line.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    line.control_modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
    line.input_modes -= InputModes::IXOFF | InputModes::IXANY;
    line.set_speed(baud)?;
    tcsetattr(file, OptionalActions::Now, &line)?;
    tcflush(file, QueueSelector::IFlush)?;
    Ok(())
}

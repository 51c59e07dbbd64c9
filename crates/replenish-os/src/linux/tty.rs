//! Serial lines: opening one raw at a baud rate, and pairs of pseudo-terminals to try that without
//! one.
#![expect(unsafe_code, reason = "termios, posix_openpt, ptsname_r")]

use super::sys;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

const RATES: [(u32, libc::speed_t); 18] = [
    (1_200, libc::B1200),
    (2_400, libc::B2400),
    (4_800, libc::B4800),
    (9_600, libc::B9600),
    (19_200, libc::B19200),
    (38_400, libc::B38400),
    (57_600, libc::B57600),
    (115_200, libc::B115200),
    (230_400, libc::B230400),
    (460_800, libc::B460800),
    (500_000, libc::B500000),
    (576_000, libc::B576000),
    (921_600, libc::B921600),
    (1_000_000, libc::B1000000),
    (1_500_000, libc::B1500000),
    (2_000_000, libc::B2000000),
    (3_000_000, libc::B3000000),
    (4_000_000, libc::B4000000),
];

/// The baud rates that [`Tty::open`] knows.
pub fn baud_rates() -> impl Iterator<Item = u32> {
    RATES.iter().map(|(baud, _)| *baud)
}

/// An open serial line: raw, 8 data bits, no parity, one stop bit, no flow control. Reading and
/// writing never wait: without data or room they fail with [`io::ErrorKind::WouldBlock`].
#[derive(Debug)]
pub struct Tty(File);

impl Tty {
    /// Opens the terminal at `path`, which does not become the controlling one. What had arrived
    /// before is dropped.
    ///
    /// # Errors
    /// `InvalidInput` for a rate that is not among [`baud_rates`]; `ENOTTY` if `path` is not a
    /// terminal; what `open(2)` says.
    pub fn open(path: &Path, baud: u32) -> io::Result<Self> {
        let rate = RATES.iter().find(|(known, _)| *known == baud);
        let &(_, speed) = rate.ok_or_else(|| {
            io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("no baud rate of terminals: {baud}"),
            )
        })?;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(libc::O_NOCTTY | libc::O_NONBLOCK)
            .open(path)?;
        make_raw(&file, speed)?;
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
        let flags = libc::O_RDWR | libc::O_NOCTTY | libc::O_NONBLOCK | libc::O_CLOEXEC;
        // SAFETY: no memory is passed.
        let fd = sys::check(unsafe { libc::posix_openpt(flags) })?;
        // SAFETY: the descriptor is new, open and owned by nobody else.
        let file = File::from(unsafe { OwnedFd::from_raw_fd(fd) });
        // SAFETY: no memory is passed.
        sys::check(unsafe { libc::grantpt(fd) })?;
        // SAFETY: no memory is passed.
        sys::check(unsafe { libc::unlockpt(fd) })?;
        let mut name = [0_u8; 128];
        // SAFETY: as many writable bytes as announced.
        let rc = unsafe { libc::ptsname_r(fd, name.as_mut_ptr().cast(), name.len()) };
        if rc != 0 {
            return Err(io::Error::from_raw_os_error(rc));
        }
        let name = name.iter().copied().take_while(|byte| *byte != 0).collect();
        make_raw(&file, libc::B115200)?;
        Ok(Self {
            tty: Tty(file),
            path: std::ffi::OsString::from_vec(name).into(),
        })
    }

    /// The terminal at the other end.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn make_raw(file: &File, speed: libc::speed_t) -> io::Result<()> {
    let fd = file.as_raw_fd();
    let mut termios = MaybeUninit::<libc::termios>::uninit();
    // SAFETY: room for a `termios`.
    sys::check(unsafe { libc::tcgetattr(fd, termios.as_mut_ptr()) })?;
    // SAFETY: the call above has succeeded, so it is filled.
    let mut termios = unsafe { termios.assume_init() };
    // SAFETY: a valid `termios`.
    unsafe { libc::cfmakeraw(&raw mut termios) };
    termios.c_cflag |= libc::CLOCAL | libc::CREAD;
    termios.c_cflag &= !(libc::CSTOPB | libc::CRTSCTS);
    termios.c_iflag &= !(libc::IXOFF | libc::IXANY);
    // SAFETY: a valid `termios`.
    sys::check(unsafe { libc::cfsetspeed(&raw mut termios, speed) })?;
    // SAFETY: a valid `termios`.
    sys::check(unsafe { libc::tcsetattr(fd, libc::TCSANOW, &raw const termios) })?;
    // SAFETY: no memory is passed.
    sys::check(unsafe { libc::tcflush(fd, libc::TCIFLUSH) })?;
    Ok(())
}

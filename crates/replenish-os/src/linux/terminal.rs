//! A terminal that a program draws on: its size, keys as they are pressed, and its settings given
//! back.

use super::clock::monotonic;
use super::poll::{PollFd, poll};
use rustix::termios::{
    LocalModes, OptionalActions, SpecialCodeIndex, Termios, tcgetattr, tcgetwinsize, tcsetattr,
};
use std::io::{self, IsTerminal, Write};
use std::os::fd::AsFd;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// The other screen, without a cursor and without wrapping; and back.
const ENTER: &str = "\x1b[?1049h\x1b[?25l\x1b[?7l";
const LEAVE: &str = "\x1b[?7h\x1b[?25h\x1b[?1049l";

/// The settings to give back; `None` while no screen is open.
static BEFORE: Mutex<Option<Termios>> = Mutex::new(None);

/// The terminal of standard input and output, drawn on until this is dropped.
///
/// Keys come as they are pressed and are not echoed; Ctrl-C is SIGINT as ever, Ctrl-Z does nothing.
/// A panic gives the terminal back before its message is printed.
#[derive(Debug)]
pub struct Terminal(());

impl Terminal {
    /// Whether standard input and standard output are terminals.
    #[must_use]
    pub fn is_there() -> bool {
        io::stdin().is_terminal() && io::stdout().is_terminal()
    }

    /// Opens the screen; one at a time.
    ///
    /// # Errors
    /// `ENOTTY` if standard input is no terminal; `AlreadyExists` while there is a screen.
    pub fn open() -> io::Result<Self> {
        let stdin = io::stdin();
        let before = tcgetattr(stdin.as_fd())?;
        let mut mode = before.clone();
        mode.local_modes -= LocalModes::ICANON | LocalModes::ECHO;
        mode.special_codes[SpecialCodeIndex::VSUSP] = 0;
        let mut kept = BEFORE.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.is_some() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        tcsetattr(stdin.as_fd(), OptionalActions::Flush, &mode)?;
        *kept = Some(before);
        drop(kept);
        let earlier = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            give_back();
            earlier(info);
        }));
        let screen = Self(());
        screen.write(ENTER)?;
        Ok(screen)
    }

    /// Columns and rows; 80 and 24 where the terminal does not say.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        let size = tcgetwinsize(io::stdout().as_fd()).ok();
        let size = size.filter(|size| size.ws_col > 0 && size.ws_row > 0);
        size.map_or((80, 24), |size| (size.ws_col.into(), size.ws_row.into()))
    }

    /// Writes all of it.
    ///
    /// # Errors
    /// As `write(2)`, when the terminal is gone.
    pub fn write(&self, text: &str) -> io::Result<()> {
        let mut out = io::stdout().lock();
        out.write_all(text.as_bytes())?;
        out.flush()
    }

    /// Bytes of keys that were pressed: waits for them, but not longer than `limit`.
    ///
    /// # Errors
    /// `UnexpectedEof` when the terminal is gone.
    pub fn keys<'b>(&self, limit: Duration, buffer: &'b mut [u8]) -> io::Result<&'b [u8]> {
        let stdin = io::stdin();
        let limit = u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX);
        let deadline = monotonic().saturating_add(limit);
        if poll(&mut [PollFd::readable(&stdin)], Some(deadline))? == 0 {
            return Ok(&[]);
        }
        // Past the buffer of the standard library, at which no wait looks.
        let read = rustix::io::read(stdin.as_fd(), &mut *buffer)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(buffer.get(..read).unwrap_or_default())
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        give_back();
    }
}

fn give_back() {
    let mut kept = BEFORE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(before) = kept.take() {
        let mut out = io::stdout().lock();
        // If the terminal is gone, there is nothing to restore.
        out.write_all(LEAVE.as_bytes())
            .and_then(|()| out.flush())
            .ok();
        tcsetattr(io::stdin().as_fd(), OptionalActions::Now, &before).ok();
    }
}

//! A place in the source that logs: its file and line, and how often it may speak.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU16, AtomicU64, AtomicUsize, Ordering};

/// The most sites with a file and line on `/rosout`; further ones appear without.
const MOST: usize = 2048;
/// The number of a site that came too late for the table.
const NONE: u16 = u16::MAX;

static SITES: [OnceLock<&LogSite>; MOST] = [const { OnceLock::new() }; MOST];
static NEXT: AtomicUsize = AtomicUsize::new(0);

/// A place in the source that logs. The macros make one for each of their uses.
#[doc(hidden)]
#[derive(Debug)]
pub struct LogSite {
    pub(super) file: &'static str,
    pub(super) line: u32,
    pub(super) module: &'static str,
    /// Its place in the table, counted from 1; 0 before it has one.
    number: AtomicU16,
    pub(super) said: AtomicBool,
    /// Time at which it may speak again, if it is throttled.
    pub(super) next: AtomicU64,
}

/// The site with this number.
pub(super) fn site(number: u16) -> Option<&'static LogSite> {
    let at = usize::from(number).checked_sub(1)?;
    SITES.get(at)?.get().copied()
}

impl LogSite {
    #[doc(hidden)]
    #[must_use]
    pub const fn new(file: &'static str, line: u32, module: &'static str) -> Self {
        Self {
            file,
            line,
            module,
            number: AtomicU16::new(0),
            said: AtomicBool::new(false),
            next: AtomicU64::new(0),
        }
    }

    /// Two threads that come first at once take a number each: one of them is not used.
    pub(super) fn number(&'static self) -> u16 {
        match self.number.load(Ordering::Relaxed) {
            0 => {
                let at = NEXT.fetch_add(1, Ordering::Relaxed);
                let free = SITES.get(at).is_some_and(|slot| slot.set(self).is_ok());
                let number = u16::try_from(at + 1).ok().filter(|_| free);
                let number = number.unwrap_or(NONE);
                self.number.store(number, Ordering::Relaxed);
                number
            }
            number => number,
        }
    }
}

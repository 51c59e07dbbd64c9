//! The error of a refused operation: a fixed text, and the kernel's error number if there is one.

use core::fmt;

/// Reason why an operation was refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OsError {
    what: &'static str,
    errno: i32,
}

impl OsError {
    pub(crate) const fn new(what: &'static str) -> Self {
        let what = if cfg!(feature = "compact") { "" } else { what };
        Self { what, errno: 0 }
    }

    /// The answer of a call of the kernel.
    #[cfg_attr(
        not(any(target_os = "nuttx", nuttx_host)),
        expect(dead_code, reason = "no such numbers there")
    )]
    pub(crate) const fn call(what: &'static str, errno: i32) -> Self {
        Self { what, errno }
    }

    /// The kernel's number for it (`errno`); 0 if there is none.
    #[must_use]
    pub const fn errno(&self) -> i32 {
        self.errno
    }
}

impl fmt::Display for OsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.what)?;
        if self.errno != 0 {
            write!(f, " (error {})", self.errno)?;
        }
        Ok(())
    }
}

impl core::error::Error for OsError {}

//! Lines on standard output, through C's `write`.

use core::ffi::{c_int, c_void};
use core::fmt;

unsafe extern "C" {
    fn write(fd: c_int, bytes: *const c_void, count: usize) -> isize;
}

/// Standard output.
pub(crate) struct Out;

impl fmt::Write for Out {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let mut rest = s.as_bytes();
        while !rest.is_empty() {
            // SAFETY: readable bytes that live across the call.
            let done = unsafe { write(1, rest.as_ptr().cast(), rest.len()) };
            match usize::try_from(done) {
                Ok(done) if done > 0 => rest = rest.get(done..).unwrap_or_default(),
                _ => return Err(fmt::Error),
            }
        }
        Ok(())
    }
}

/// A line.
#[macro_export]
macro_rules! say {
    ($($what:tt)*) => {{
        use core::fmt::Write as _;
        let _ = writeln!($crate::print::Out, $($what)*);
    }};
}

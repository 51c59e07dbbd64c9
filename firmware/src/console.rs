//! Text to the host, and the end of a run, by semihosting.

use core::fmt::{self, Write};

/// The host's console.
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        print(s.as_ptr(), s.len());
        Ok(())
    }
}

/// Prints a line.
#[macro_export]
macro_rules! say {
    ($($arg:tt)*) => {{
        use core::fmt::Write as _;
        writeln!($crate::console::Console, $($arg)*).ok();
    }};
}

fn print(text: *const u8, bytes: usize) {
    let mut chunk = [0_u8; 65];
    let mut done = 0;
    while done < bytes {
        let part = (bytes - done).min(64);
        // SAFETY: `done + part` is within the caller's text, `part` within the chunk.
        unsafe {
            chunk
                .as_mut_ptr()
                .copy_from_nonoverlapping(text.add(done), part)
        };
        chunk[part] = 0;
        call(0x04, chunk.as_ptr() as usize); // SYS_WRITE0
        done += part;
    }
}

#[unsafe(no_mangle)]
extern "C" fn rp_board_print(text: *const u8, bytes: usize) {
    print(text, bytes);
}

/// Ends the emulation: success or not.
pub fn exit(ok: bool) -> ! {
    let code = if ok { 0x20026 } else { 0x20023 }; // ADP_Stopped_ApplicationExit, _RunTimeErrorUnknown
    loop {
        call(0x18, code); // SYS_EXIT
    }
}

fn call(operation: usize, argument: usize) -> usize {
    let result;
    // SAFETY: a semihosting call; without a host it is a fault, which ends the image.
    unsafe {
        core::arch::asm!("bkpt 0xAB", inlateout("r0") operation => result, in("r1") argument)
    };
    result
}

/// The command line that the host gave the image, up to the size of `buffer`.
pub fn command_line(buffer: &mut [u8]) -> &str {
    let mut block = [buffer.as_mut_ptr() as usize, buffer.len()];
    if call(0x15, block.as_mut_ptr() as usize) != 0 {
        return ""; // SYS_GET_CMDLINE
    }
    let length = buffer.iter().position(|&b| b == 0).unwrap_or(0);
    core::str::from_utf8(&buffer[..length]).unwrap_or("")
}

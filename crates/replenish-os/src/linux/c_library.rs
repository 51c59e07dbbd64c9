//! The address range of the C library's code. A thread that is stopped in there may hold one of the
//! library's locks, the heap's for instance, and these have no priority inheritance.
//!
//! Found once, at set-up, by the names of the loaded objects. In a program that is linked
//! statically the library is part of the program, and is not found.
#![expect(unsafe_code, reason = "dl_iterate_phdr, the context of a signal")]

use std::ffi::{CStr, c_int, c_void};
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Begin and end of each stretch of code; 0 where there is none.
static CODE: [[AtomicUsize; 2]; 4] = [const { [const { AtomicUsize::new(0) }; 2] }; 4];

/// Finds the library. Takes the loader's lock: not in a signal handler.
pub(super) fn find() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // SAFETY: the callback has the expected signature and unwinds from nothing; its data is
        // not used.
        unsafe { libc::dl_iterate_phdr(Some(look_at), std::ptr::null_mut()) };
    });
}

/// Whether `address` is in its code. Async-signal-safe.
pub(super) fn contains(address: usize) -> bool {
    CODE.iter().any(|[begin, end]| {
        (begin.load(Ordering::Acquire)..end.load(Ordering::Acquire)).contains(&address)
    })
}

/// Looks at one loaded object.
unsafe extern "C" fn look_at(
    info: *mut libc::dl_phdr_info,
    _size: usize,
    _data: *mut c_void,
) -> c_int {
    // SAFETY: the loader passes a valid description that lives across the call.
    let info = unsafe { &*info };
    if info.dlpi_name.is_null() || info.dlpi_phdr.is_null() {
        return 0;
    }
    // SAFETY: the loader's name of the object ends with a null byte and lives across the call.
    let name = unsafe { CStr::from_ptr(info.dlpi_name) };
    if !is_library(name.to_bytes()) {
        return 0;
    }
    // SAFETY: the loader gives the address and the number of the object's program headers.
    let headers = unsafe { std::slice::from_raw_parts(info.dlpi_phdr, info.dlpi_phnum.into()) };
    for header in headers {
        if header.p_type != libc::PT_LOAD || header.p_flags & libc::PF_X == 0 {
            continue;
        }
        let word = |value| usize::try_from(value).unwrap_or(0);
        let begin = word(info.dlpi_addr).wrapping_add(word(header.p_vaddr));
        note(begin, begin.wrapping_add(word(header.p_memsz)));
    }
    0
}

fn note(begin: usize, end: usize) {
    let free = CODE.iter().find(|[_, e]| e.load(Ordering::Relaxed) == 0);
    if let Some([b, e]) = free {
        b.store(begin, Ordering::Release);
        e.store(end, Ordering::Release);
    }
}

/// `libc.so.6`, `libc-2.31.so`, `ld-linux-x86-64.so.2`, `ld-musl-x86_64.so.1`.
fn is_library(path: &[u8]) -> bool {
    let file = path.rsplit(|byte| *byte == b'/').next().unwrap_or(path);
    let names: [&[u8]; 4] = [b"libc.so", b"libc-", b"ld-linux", b"ld-musl"];
    names.iter().any(|name| file.starts_with(name))
}

/// Address at which a signal interrupted the thread; `None` on processors unknown to this file.
///
/// # Safety
/// `context` is the third argument of a handler that was installed with `SA_SIGINFO`.
pub(super) unsafe fn interrupted_at(context: *const c_void) -> Option<usize> {
    // SAFETY: the kernel passes a `ucontext_t`, by the caller's promise.
    let context = unsafe { context.cast::<libc::ucontext_t>().as_ref() }?;
    program_counter(context)
}

#[cfg(target_arch = "x86_64")]
fn program_counter(context: &libc::ucontext_t) -> Option<usize> {
    let register = usize::try_from(libc::REG_RIP).ok()?;
    let pc = *context.uc_mcontext.gregs.get(register)?;
    Some(usize::from_ne_bytes(pc.to_ne_bytes()))
}

#[cfg(target_arch = "aarch64")]
fn program_counter(context: &libc::ucontext_t) -> Option<usize> {
    usize::try_from(context.uc_mcontext.pc).ok()
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn program_counter(_: &libc::ucontext_t) -> Option<usize> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg_attr(miri, ignore = "has no loader")]
    fn the_library_is_found_and_the_program_is_not_in_it() {
        find();
        if cfg!(not(target_feature = "crt-static")) {
            assert!(contains(libc::getpid as *const () as usize));
        }
        assert!(!contains(find as *const () as usize));
        assert!(!contains(0));
    }

    #[test]
    fn only_the_library_and_the_loader_count() {
        let counted: Vec<_> = ["/lib/libc.so.6", "libc-2.31.so", "/a/ld-musl-armhf.so.1"]
            .map(|name| is_library(name.as_bytes()))
            .into();
        assert_eq!(counted, [true; 3]);
        let others = [
            "",
            "/lib/libcrypto.so.3",
            "/libc.so.6/program",
            "libcap.so.2",
        ];
        assert!(others.iter().all(|name| !is_library(name.as_bytes())));
    }
}

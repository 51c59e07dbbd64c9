//! Memory in which a program records, and that others may read: a file that is mapped, or none.
//!
//! The file stands in a directory in which strangers may write: no link is followed. Until it is
//! complete, only its owner can open it. It must lie in a file system that is memory (tmpfs): on a
//! disk, writing back would hold up every thread that writes to the map.
#![expect(unsafe_code, reason = "mmap, munmap, fstatfs")]

use super::clock;
pub use super::live_file::{LiveFile, open_directory};
use super::sys;
use replenish_recorder::{Clocks, Span};
use rustix::mm::{MapFlags, ProtFlags, mmap, mmap_anonymous, munmap};
use std::fs::{File, OpenOptions};
use std::io;
use std::mem::MaybeUninit;
use std::ops::Deref;
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Words of memory that this process writes, and that others may read.
///
/// Every page was touched: using it causes no page fault.
#[derive(Debug)]
pub struct SharedMemory {
    start: NonNull<AtomicU64>,
    words: usize,
}

// SAFETY: the words are atomics, and the mapping belongs to this value alone.
unsafe impl Send for SharedMemory {}
// SAFETY: as above.
unsafe impl Sync for SharedMemory {}

impl SharedMemory {
    /// Maps the first `bytes` bytes of `file`, which must keep its length. Truncating it ends this
    /// program, as its owner and root can in other ways.
    ///
    /// # Errors
    /// If the file is shorter, or cannot be mapped.
    pub fn of_file(file: &File, bytes: usize) -> io::Result<Self> {
        if file.metadata()?.len() < bytes as u64 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping at a place of the kernel's choice.
        let start = unsafe { mmap(null_mut(), bytes, access, MapFlags::SHARED, file, 0) }?;
        Self::touched(start, bytes)
    }

    /// Maps this many bytes for this process alone; they are freed when the value is dropped.
    ///
    /// # Errors
    /// If there is no memory.
    pub fn private(bytes: usize) -> io::Result<Self> {
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping at a place of the kernel's choice.
        let start = unsafe { mmap_anonymous(null_mut(), bytes, access, MapFlags::PRIVATE) }?;
        Self::touched(start, bytes)
    }

    fn touched(start: *mut std::ffi::c_void, bytes: usize) -> io::Result<Self> {
        let start = NonNull::new(start.cast()).ok_or(io::ErrorKind::AddrNotAvailable)?;
        let words = bytes / size_of::<AtomicU64>();
        let memory = Self { start, words };
        let page = memory.iter().step_by(512);
        page.for_each(|word| word.store(0, Ordering::Relaxed));
        Ok(memory)
    }
}

impl Deref for SharedMemory {
    type Target = [AtomicU64];

    #[inline]
    fn deref(&self) -> &[AtomicU64] {
        // SAFETY: `words` words are mapped there until this value is dropped, on a page boundary,
        // and any bits are a number.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.words) }
    }
}

impl Drop for SharedMemory {
    fn drop(&mut self) {
        let bytes = self.words * size_of::<AtomicU64>();
        // SAFETY: this value mapped it, and nothing points there any more.
        unsafe { munmap(self.start.as_ptr().cast(), bytes) }.ok();
    }
}

/// A stretch of a [`SharedMemory`]. A thread that writes to it reads none of the memory's own
/// fields, which other threads' caches hold.
#[derive(Debug)]
pub struct SharedSlice {
    start: NonNull<AtomicU64>,
    words: usize,
    /// Keeps the mapping.
    _memory: Arc<SharedMemory>,
}

// SAFETY: the words are atomics, and the memory may be used on any thread.
unsafe impl Send for SharedSlice {}
// SAFETY: as above.
unsafe impl Sync for SharedSlice {}

impl SharedSlice {
    /// The words of `span`; none where the memory is shorter.
    #[must_use]
    pub fn new(memory: &Arc<SharedMemory>, span: Span) -> Self {
        let words = span.of(memory);
        Self {
            start: NonNull::from(words).cast(),
            words: words.len(),
            _memory: Arc::clone(memory),
        }
    }
}

impl Deref for SharedSlice {
    type Target = [AtomicU64];

    #[inline]
    fn deref(&self) -> &[AtomicU64] {
        // SAFETY: a slice of `_memory` had this start and length, and `_memory` is still mapped.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.words) }
    }
}

/// Whether the file lies in memory (tmpfs, ramfs), and not on a disk.
///
/// # Errors
/// If the kernel does not tell.
pub fn is_in_memory(file: &File) -> io::Result<bool> {
    const RAMFS: i64 = 0x8584_58f6;
    let mut facts = MaybeUninit::<libc::statfs>::uninit();
    // SAFETY: the descriptor is open, and the call writes to room of the right size.
    if unsafe { libc::fstatfs(file.as_raw_fd(), facts.as_mut_ptr()) } != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the call has succeeded.
    let kind = unsafe { facts.assume_init() }.f_type;
    #[allow(clippy::unnecessary_cast, reason = "32 bits on some processors")]
    Ok([libc::TMPFS_MAGIC as i64, RAMFS].contains(&(kind as i64)))
}

/// Creates a file that only this account can open yet.
///
/// # Errors
/// As of `open(2)`; if there is a file or a link of that name.
pub fn create(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create_new(true).mode(0o600);
    options.open(path)
}

/// Opens an ordinary file for reading: no link is followed, no pipe is waited for.
///
/// # Errors
/// As of `open(2)`; if it is not an ordinary file.
pub fn open_plain(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)?;
    if file.metadata()?.is_file() {
        Ok(file)
    } else {
        Err(io::Error::other("it is not an ordinary file"))
    }
}

/// The account that this process acts for.
#[must_use]
pub fn account() -> u32 {
    rustix::process::geteuid().as_raw()
}

/// The clocks at this moment.
#[must_use]
pub fn clocks() -> Clocks {
    let monotonic = clock::monotonic();
    let boottime = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    let boottime = u64::try_from(boottime.tv_sec)
        .unwrap_or(0)
        .saturating_mul(sys::NANOS_PER_SEC)
        .saturating_add(u64::try_from(boottime.tv_nsec).unwrap_or(0));
    let realtime = SystemTime::now().duration_since(UNIX_EPOCH);
    Clocks {
        monotonic,
        boottime,
        realtime: realtime.map_or(0, |d| u64::try_from(d.as_nanos()).unwrap_or(u64::MAX)),
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_file_shows_what_is_stored_in_its_map() {
        let path = Path::new("/dev/shm").join(format!("replenish-os-{}", std::process::id()));
        let mut file = create(&path).unwrap();
        assert!(create(&path).is_err(), "it is there");
        file.write_all(&[0; 8192]).unwrap();
        assert!(is_in_memory(&file).unwrap());
        assert!(SharedMemory::of_file(&file, 16384).is_err(), "too short");
        let memory = SharedMemory::of_file(&file, 8192).unwrap();
        assert_eq!(memory.len(), 1024);
        memory[1000].store(u64::from_le_bytes(*b"recorder"), Ordering::Release);
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[8000..8008], b"recorder");
        let link = path.with_extension("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        assert!(open_plain(&link).is_err() && open_plain(&path).is_ok());
        std::fs::remove_file(&link).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(
            SharedMemory::private(4096)
                .unwrap()
                .iter()
                .all(|w| w.load(Ordering::Relaxed) == 0)
        );
    }

    #[test]
    fn a_slice_keeps_the_memory_and_ends_with_it() {
        let memory = Arc::new(SharedMemory::private(4096).unwrap());
        let span = |start, words| Span { start, words };
        let [slice, beyond] = [(500, 12), (500, 13)].map(|(start, words)| {
            let slice = SharedSlice::new(&memory, span(start, words));
            slice
                .iter()
                .for_each(|word| word.store(7, Ordering::Relaxed));
            slice
        });
        assert_eq!((slice.len(), beyond.len()), (12, 0));
        assert_eq!(
            memory[499..501]
                .iter()
                .map(|w| w.load(Ordering::Relaxed))
                .sum::<u64>(),
            7
        );
        drop(memory);
        assert!(slice.iter().all(|word| word.load(Ordering::Relaxed) == 7));
    }

    #[test]
    fn the_clocks_are_of_one_moment() {
        let clocks = clocks();
        assert!(clocks.boottime >= clocks.monotonic);
        assert!(clocks.realtime > clocks.boottime);
        assert!(!is_in_memory(&File::open("/proc/self/stat").unwrap()).unwrap());
    }
}

//! Memory of one process from which others fetch samples: slots with a stamp each, without a lock.
//!
//! ```text
//!   words   mark, cookie, slots, words of a slot │ stamp of each slot │ slot │ slot │ …
//!
//!   write   stamp 0 ─ bytes ─ stamp            read   stamp as expected? ─ bytes ─ stamp still?
//! ```
//!
//! It is a `memfd`: it has no name that a killed process could leave behind, and is gone with the
//! last process that has it open. It is sealed: nobody can make it shorter, so that no reader ends
//! by a signal, and nobody but its maker can write to it (Linux 5.1). Another process of the same
//! account opens it under `/proc/PID/fd`, if the kernel allows that one to look at the maker.
//!
//! Nothing in it is trusted: a reader computes every place from what it has checked when it opened
//! the memory, and copies once.
#![expect(unsafe_code, reason = "mmap, memfd_create, fcntl, posix_fallocate")]

use super::live::{SharedMemory, account};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::fs::{File, OpenOptions};
use std::io::{self, Error, ErrorKind};
use std::os::fd::{AsRawFd, FromRawFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::ptr::{NonNull, null_mut};
use std::sync::atomic::{AtomicU64, Ordering, fence};

const MARK: u64 = u64::from_le_bytes(*b"rplshm01");
/// Words before the stamps.
const HEAD: usize = 8;
const WORD: usize = size_of::<u64>();
/// A slot begins on a page.
const PAGE: usize = 4096 / WORD;
/// Bytes of the largest memory that is opened.
const MOST: u64 = 1 << 30;
const SEALS: libc::c_int = libc::F_SEAL_SHRINK | libc::F_SEAL_GROW | libc::F_SEAL_SEAL;
/// `F_SEAL_FUTURE_WRITE`, which not every C library names.
const FUTURE_WRITE: libc::c_int = 0x10;
/// `/proc` shows it behind this.
const TITLE: &[u8] = b"/memfd:replenish-samples";

/// The places in a memory: what its head says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    slots: usize,
    /// Words of a slot.
    words: usize,
}

impl Layout {
    /// `None`: more than an address can say.
    fn of(slots: usize, bytes: usize) -> Option<Self> {
        let words = bytes.div_ceil(WORD).checked_next_multiple_of(PAGE)?;
        let layout = Layout { slots, words };
        let fits = layout.bytes().is_some_and(|bytes| bytes as u64 <= MOST);
        (fits && slots > 0 && words > 0).then_some(layout)
    }

    fn first(self) -> Option<usize> {
        let head = HEAD.checked_add(self.slots)?;
        head.checked_next_multiple_of(PAGE)
    }

    /// Bytes of the whole memory.
    fn bytes(self) -> Option<usize> {
        let slots = self.slots.checked_mul(self.words)?;
        slots.checked_add(self.first()?)?.checked_mul(WORD)
    }

    /// The words of a slot.
    fn slot(self, memory: &[AtomicU64], slot: usize) -> Option<(&AtomicU64, &[AtomicU64])> {
        let at = self.first()?.checked_add(slot.checked_mul(self.words)?)?;
        if slot >= self.slots {
            return None;
        }
        let stamp = memory.get(HEAD.checked_add(slot)?)?;
        Some((stamp, memory.get(at..at.checked_add(self.words)?)?))
    }
}

/// Memory of this process from which others fetch samples.
#[derive(Debug)]
pub struct SegmentWriter {
    memory: SharedMemory,
    /// Others open it.
    file: File,
    layout: Layout,
    cookie: u64,
    stamp: u64,
}

impl SegmentWriter {
    /// Memory of `slots` samples of at most `bytes` bytes, all of it taken and touched here. The
    /// cookie is a number that no other memory of this host has.
    ///
    /// # Errors
    /// If there is no memory, or more than 1 GiB is asked for.
    pub fn new(slots: usize, bytes: usize, cookie: u64) -> io::Result<Self> {
        let layout = Layout::of(slots, bytes).ok_or(ErrorKind::InvalidInput)?;
        let bytes = layout.bytes().ok_or(ErrorKind::InvalidInput)?;
        let file = memory(libc::MFD_CLOEXEC | libc::MFD_ALLOW_SEALING)?;
        let len = libc::off_t::try_from(bytes).map_err(|_| ErrorKind::InvalidInput)?;
        // Memory that there is not is refused here, not by a signal.
        // SAFETY: the descriptor is open.
        let taken = unsafe { libc::posix_fallocate(file.as_raw_fd(), 0, len) };
        if taken != 0 {
            return Err(Error::from_raw_os_error(taken));
        }
        let memory = SharedMemory::of_file(&file, bytes)?;
        seal(&file)?;
        let head = [MARK, cookie, slots as u64, layout.words as u64];
        for (word, value) in memory.iter().zip(head) {
            word.store(value, Ordering::Release);
        }
        Ok(Self {
            memory,
            file,
            layout,
            cookie,
            stamp: 0,
        })
    }

    /// The name under which other processes open it.
    #[must_use]
    pub fn name(&self) -> [u8; 16] {
        let numbers = [std::process::id(), self.file.as_raw_fd().unsigned_abs()];
        let bytes = numbers.iter().flat_map(|number| number.to_le_bytes());
        let mut name = [0; 16];
        let bytes = bytes.chain(self.cookie.to_le_bytes());
        name.iter_mut().zip(bytes).for_each(|(to, from)| *to = from);
        name
    }

    /// Puts a sample into the slot whose turn it is: the slot, and its stamp. `None` if the sample
    /// is longer than a slot.
    pub fn put(&mut self, bytes: &[u8]) -> Option<(u32, u64)> {
        let next = self.stamp.wrapping_add(1);
        let at = usize::try_from(next).ok()?.checked_rem(self.layout.slots)?;
        let (stamp, words) = self.layout.slot(&self.memory, at)?;
        if bytes.len() > words.len().saturating_mul(WORD) {
            return None;
        }
        stamp.store(0, Ordering::Relaxed);
        fence(Ordering::Release);
        let (whole, rest) = bytes.as_chunks::<WORD>();
        for (word, bytes) in words.iter().zip(whole) {
            word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
        }
        if let Some(word) = words.get(whole.len()).filter(|_| !rest.is_empty()) {
            let mut last = [0; WORD];
            last.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
            word.store(u64::from_ne_bytes(last), Ordering::Relaxed);
        }
        stamp.store(next, Ordering::Release);
        self.stamp = next;
        Some((u32::try_from(at).ok()?, next))
    }
}

/// A file that is memory, and has no name.
fn memory(flags: libc::c_uint) -> io::Result<File> {
    // SAFETY: the name is a string that ends.
    let fd = unsafe { libc::memfd_create(c"replenish-samples".as_ptr(), flags) };
    if fd < 0 {
        return Err(Error::last_os_error());
    }
    // SAFETY: the descriptor is new, and nobody else has it.
    Ok(unsafe { File::from_raw_fd(fd) })
}

fn seal(file: &File) -> io::Result<()> {
    let seal = |seals: libc::c_int| {
        // SAFETY: the descriptor is open, and the argument is a number.
        unsafe { libc::fcntl(file.as_raw_fd(), libc::F_ADD_SEALS, seals) == 0 }
    };
    // Linux before 5.1 does not know the second one.
    if seal(SEALS | FUTURE_WRITE) || seal(SEALS) {
        Ok(())
    } else {
        Err(Error::last_os_error())
    }
}

/// How a sample was fetched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetched {
    /// All of its bytes are there.
    Whole,
    /// The slot has another sample by now.
    Overwritten,
    /// There is no such slot, or it is shorter than the sample.
    Broken,
}

/// Memory of another process from which samples are fetched.
#[derive(Debug)]
pub struct SegmentReader {
    start: NonNull<AtomicU64>,
    words: usize,
    layout: Layout,
}

// SAFETY: the words are only read, as atomics, and the mapping belongs to this value alone.
unsafe impl Send for SegmentReader {}
// SAFETY: as above.
unsafe impl Sync for SegmentReader {}

impl SegmentReader {
    /// Opens the memory of this name.
    ///
    /// # Errors
    /// If it is not there, as in another container, if the kernel does not let this process look at
    /// its maker, and if it is not what it should be.
    pub fn open(name: [u8; 16]) -> io::Result<Self> {
        let [a, b, c, d, e, f, g, h, cookie @ ..] = name;
        let process = u32::from_le_bytes([a, b, c, d]);
        let descriptor = u32::from_le_bytes([e, f, g, h]);
        let path = format!("/proc/{process}/fd/{descriptor}");
        // A name is a stranger's word: nothing else is opened, since that can do something.
        let title = std::fs::read_link(&path)?;
        if !title.as_os_str().as_bytes().starts_with(TITLE) {
            return Err(ErrorKind::InvalidData.into());
        }
        let mut options = OpenOptions::new();
        let file = options.read(true).custom_flags(libc::O_NONBLOCK);
        Self::of_file(&file.open(&path)?, u64::from_le_bytes(cookie))
    }

    fn of_file(file: &File, cookie: u64) -> io::Result<Self> {
        let facts = file.metadata()?;
        // SAFETY: the descriptor is open.
        let seals = unsafe { libc::fcntl(file.as_raw_fd(), libc::F_GET_SEALS) };
        let sealed = seals >= 0 && seals & SEALS == SEALS;
        let size = (HEAD * WORD) as u64..=MOST;
        if !facts.is_file() || facts.uid() != account() || !sealed || !size.contains(&facts.len()) {
            return Err(ErrorKind::InvalidData.into());
        }
        let bytes = usize::try_from(facts.len()).map_err(|_| ErrorKind::InvalidData)?;
        // SAFETY: a new mapping at a place of the kernel's choice; the seals keep the length.
        let start = unsafe {
            mmap(
                null_mut(),
                bytes,
                ProtFlags::READ,
                MapFlags::SHARED,
                file,
                0,
            )
        }?;
        let start = NonNull::new(start.cast()).ok_or(ErrorKind::AddrNotAvailable)?;
        let mut reader = Self {
            start,
            words: bytes / WORD,
            layout: Layout { slots: 0, words: 0 },
        };
        let head = |at: usize| {
            let word = reader.memory().get(at);
            word.map_or(0, |word| word.load(Ordering::Acquire))
        };
        let number = |at| usize::try_from(head(at)).unwrap_or(usize::MAX);
        let layout = number(3)
            .checked_mul(WORD)
            .and_then(|bytes| Layout::of(number(2), bytes));
        let known = [head(0), head(1)] == [MARK, cookie];
        let layout = layout.filter(|layout| known && layout.bytes() == Some(bytes));
        reader.layout = layout.ok_or(ErrorKind::InvalidData)?;
        Ok(reader)
    }

    fn memory(&self) -> &[AtomicU64] {
        // SAFETY: so many words are mapped there until this value is dropped, on a page boundary;
        // they are only read, and any bits are a number.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.words) }
    }

    /// Copies the sample that has this stamp into `room`.
    pub fn read(&self, slot: u32, stamp: u64, room: &mut [u8]) -> Fetched {
        let slot = usize::try_from(slot).unwrap_or(usize::MAX);
        let Some((now, words)) = self.layout.slot(self.memory(), slot) else {
            return Fetched::Broken;
        };
        if room.len() > words.len().saturating_mul(WORD) {
            return Fetched::Broken;
        }
        if now.load(Ordering::Acquire) != stamp {
            return Fetched::Overwritten;
        }
        let (whole, rest) = room.as_chunks_mut::<WORD>();
        let last = words.get(whole.len());
        for (to, word) in whole.iter_mut().zip(words) {
            *to = word.load(Ordering::Relaxed).to_ne_bytes();
        }
        if let Some(word) = last {
            let bytes = word.load(Ordering::Relaxed).to_ne_bytes();
            rest.iter_mut().zip(bytes).for_each(|(to, from)| *to = from);
        }
        fence(Ordering::Acquire);
        if now.load(Ordering::Relaxed) == stamp {
            Fetched::Whole
        } else {
            Fetched::Overwritten
        }
    }
}

impl Drop for SegmentReader {
    fn drop(&mut self) {
        let bytes = self.words * WORD;
        // SAFETY: this value mapped it, and nothing points there any more.
        unsafe { munmap(self.start.as_ptr().cast(), bytes) }.ok();
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    fn sample(number: u8, len: usize) -> Vec<u8> {
        (0..len).map(|at| (at as u8).wrapping_mul(number)).collect()
    }

    #[test]
    fn samples_are_fetched_until_their_slot_is_used_again() {
        let mut writer = SegmentWriter::new(3, 10_000, 7).unwrap();
        let reader = SegmentReader::open(writer.name()).unwrap();
        let mut room = vec![0; 10_000];
        let mut places = Vec::new();
        for number in 1..=9 {
            let bytes = sample(number, 9_990 + usize::from(number));
            let (slot, stamp) = writer.put(&bytes).unwrap();
            let room = &mut room[..bytes.len()];
            assert_eq!(reader.read(slot, stamp, room), Fetched::Whole);
            assert_eq!(*room, bytes);
            places.push((slot, stamp));
        }
        let read = |at: usize, room: &mut [u8]| reader.read(places[at].0, places[at].1, room);
        for at in 0..9 {
            let whole = read(at, &mut room[..9_991]) == Fetched::Whole;
            assert_eq!(whole, at >= 6, "of nine samples the last three");
        }
        assert_eq!(read(8, &mut []), Fetched::Whole);
        assert!(writer.put(&vec![0; 3 * 4096 + 1]).is_none(), "too long");
    }

    #[test]
    fn places_that_are_not_there_are_broken() {
        let mut writer = SegmentWriter::new(2, 4096, 7).unwrap();
        let reader = SegmentReader::open(writer.name()).unwrap();
        let (slot, stamp) = writer.put(&[1; 4096]).unwrap();
        let mut room = vec![0; 4097];
        for slot in [2, 3, 511, 512, u32::MAX] {
            assert_eq!(reader.read(slot, stamp, &mut room[..8]), Fetched::Broken);
        }
        assert_eq!(reader.read(slot, stamp, &mut room), Fetched::Broken);
        assert_eq!(reader.read(slot, stamp, &mut room[..4096]), Fetched::Whole);
    }

    #[test]
    fn nobody_makes_it_shorter_or_writes_to_it() {
        let writer = SegmentWriter::new(2, 4096, 7).unwrap();
        assert!(writer.file.set_len(0).is_err());
        let path = format!("/proc/self/fd/{}", writer.file.as_raw_fd());
        let again = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .unwrap();
        assert!(again.set_len(100).is_err());
        assert!(SharedMemory::of_file(&again, 4096).is_err());
    }

    #[test]
    fn memory_that_is_not_what_it_should_be_is_not_opened() {
        let writer = SegmentWriter::new(2, 4096, 7).unwrap();
        let name = writer.name();
        SegmentReader::open(name).unwrap();
        let mut other = name;
        other[8] ^= 1;
        assert!(SegmentReader::open(other).is_err(), "another cookie");
        let mut other = name;
        other[4..8].copy_from_slice(&0u32.to_le_bytes());
        assert!(SegmentReader::open(other).is_err(), "no memory at all");
        let head = |at: usize, value: u64| writer.memory[at].store(value, Ordering::Release);
        for (at, value) in [
            (2, 3),
            (2, u64::MAX),
            (2, 0),
            (3, 513),
            (3, u64::MAX),
            (0, 0),
        ] {
            let before = writer.memory[at].load(Ordering::Acquire);
            head(at, value);
            assert!(SegmentReader::open(name).is_err(), "word {at} is {value}");
            head(at, before);
        }
        SegmentReader::open(name).unwrap();
        drop(writer);
        assert!(SegmentReader::open(name).is_err(), "it is gone");
    }

    #[test]
    fn memory_that_can_be_made_shorter_is_not_opened() {
        let file = memory(libc::MFD_ALLOW_SEALING).unwrap();
        let bytes = Layout::of(2, 4096).unwrap().bytes().unwrap();
        file.set_len(bytes as u64).unwrap();
        let memory = SharedMemory::of_file(&file, bytes).unwrap();
        for (word, value) in memory.iter().zip([MARK, 7, 2, 512]) {
            word.store(value, Ordering::Release);
        }
        assert!(SegmentReader::of_file(&file, 7).is_err());
        seal(&file).unwrap();
        SegmentReader::of_file(&file, 7).unwrap();
    }

    /// A slot that changes while it is read is never taken for whole.
    #[test]
    fn a_torn_sample_is_noticed() {
        let mut writer = SegmentWriter::new(2, 64 << 10, 7).unwrap();
        let reader = SegmentReader::open(writer.name()).unwrap();
        let place = AtomicU64::new(0);
        let (mut whole, mut torn) = (0, 0);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for number in 0..20_000u64 {
                    let bytes = [number as u8; 64 << 10];
                    let (_, stamp) = writer.put(&bytes).unwrap();
                    place.store(stamp, Ordering::Release);
                }
                place.store(u64::MAX, Ordering::Release);
            });
            let mut room = vec![0; 64 << 10];
            loop {
                let stamp = place.load(Ordering::Acquire);
                if stamp == u64::MAX {
                    break;
                }
                if stamp == 0 {
                    continue;
                }
                match reader.read((stamp % 2) as u32, stamp, &mut room) {
                    Fetched::Whole => {
                        whole += 1;
                        let first = (stamp - 1) as u8;
                        assert!(room.iter().all(|byte| *byte == first), "stamp {stamp}");
                    }
                    Fetched::Overwritten => torn += 1,
                    Fetched::Broken => panic!("it is there"),
                }
            }
        });
        assert!(whole + torn > 0);
    }
}

//! The program's own marks, in a recording that `replenish trace` reads.
//!
//! The recording is made with the first mark: a file of fixed size, with one ring for each thread
//! that marks something. It stays when the program ends, as that of a killed program does.

use crate::failure::{Failure, Why};
use replenish_os::live::{LiveFile, SharedMemory, account, clocks};
use replenish_os::{clock, current_tid};
use replenish_recorder::{
    Event, Kind, MAX_NAMES, NameKind, Plan, Planned, Role, Writer, write_name, write_thread_name,
    write_tid,
};
use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Names the directory of recordings, or is `off`.
const VARIABLE: &str = "REPLENISH_LIVE";
/// Threads of a process that can mark something; those that have ended count.
const THREADS: usize = 32;
/// Bytes of each thread's ring.
const RING: usize = 16 << 10;

struct Recording {
    process: u32,
    memory: SharedMemory,
    plan: Plan,
    /// Threads that have a ring.
    taken: AtomicUsize,
    names: Mutex<Vec<String>>,
    /// Its lock says that the program lives.
    _file: LiveFile,
}

/// `None`: switched off.
static RECORDING: OnceLock<Option<Recording>> = OnceLock::new();
/// Held while the recording is made.
static MAKING: Mutex<()> = Mutex::new(());

/// The calling thread's ring.
enum Place {
    New,
    Full,
    Ring(&'static Recording, usize, Writer),
}

thread_local! {
    static PLACE: RefCell<Place> = const { RefCell::new(Place::New) };
}

/// The number of the mark of this name, 1 to 2048; the same name has the same number.
///
/// Allocates, and makes the recording if there is none.
///
/// # Errors
/// The recording cannot be made, or there are 2048 marks.
pub fn new_mark(name: &str) -> Result<u32, Failure> {
    let _alone = MAKING.lock().unwrap_or_else(PoisonError::into_inner);
    if RECORDING.get().is_none() {
        let made = make()?;
        RECORDING.set(made).ok();
    }
    let Some(Some(recording)) = RECORDING.get() else {
        return Ok(1); // switched off
    };
    let mut names = recording
        .names
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    let known = names.iter().position(|known| known == name);
    let at = known.unwrap_or(names.len());
    if at == MAX_NAMES {
        let text = format!("no room for mark {name:?}: a process has {MAX_NAMES}");
        return Err(Failure::new(Why::Full, text));
    }
    let id = u32::try_from(at + 1).unwrap_or(0);
    if known.is_none() {
        names.push(name.to_owned());
        let table = recording.plan.names.of(&recording.memory);
        write_name(table, id, NameKind::Mark, name);
    }
    Ok(id)
}

/// Records that the calling thread has come to this mark. Neither allocates nor waits.
///
/// # Errors
/// [`Why::NotFound`]: there is no such mark; [`Why::Full`]: 32 threads have marked something, and
/// this is another one; [`Why::Forked`]: the process is a fork of the one that records.
pub fn mark(id: u32, value: u64) -> Result<(), Why> {
    let Some(recording) = RECORDING.get() else {
        return Err(Why::NotFound);
    };
    let Some(recording) = recording else {
        return Ok(());
    };
    if !(1..=MAX_NAMES).contains(&(id as usize)) {
        return Err(Why::NotFound);
    }
    if recording.process != std::process::id() {
        return Err(Why::Forked);
    }
    let record = |place: &RefCell<Place>| {
        // A signal's handler that interrupted a mark leaves none.
        let Ok(mut place) = place.try_borrow_mut() else {
            return Ok(());
        };
        if let Place::New = *place {
            *place = recording.place();
        }
        let Place::Ring(recording, at, writer) = &mut *place else {
            return Err(Why::Full);
        };
        if let Some(span) = recording.plan.threads.get(*at) {
            let event = Event {
                time: clock::monotonic(),
                kind: Kind::Mark,
                name: id,
                a: value,
                b: 0,
            };
            writer.write(span.ring.of(&recording.memory), &event);
        }
        Ok(())
    };
    PLACE.try_with(record).unwrap_or(Ok(()))
}

impl Recording {
    /// A ring for the calling thread.
    fn place(&'static self) -> Place {
        let at = self.taken.fetch_add(1, Ordering::Relaxed);
        let Some(span) = self.plan.threads.get(at) else {
            self.taken.store(THREADS, Ordering::Relaxed);
            return Place::Full;
        };
        let entry = span.entry.of(&self.memory);
        let tid = current_tid();
        let own = format!("/proc/self/task/{tid}/comm");
        let name = std::fs::read_to_string(own).unwrap_or_default();
        write_thread_name(entry, name.trim_end());
        write_tid(entry, u64::from(tid.get().unsigned_abs()));
        match Writer::new(span.ring.words) {
            Some(writer) => Place::Ring(self, at, writer),
            None => Place::Full,
        }
    }
}

fn make() -> Result<Option<Recording>, Failure> {
    let named = std::env::var_os(VARIABLE).filter(|value| !value.is_empty());
    let directory = match named {
        Some(off) if off == "off" => return Ok(None),
        Some(directory) => PathBuf::from(directory),
        None => PathBuf::from(format!("/dev/shm/replenish-{}", account())),
    };
    let threads = [Planned {
        name: "",
        role: Role::Worker,
        cpu: None,
        budget: None,
    }; THREADS];
    let wrong = |why: &dyn std::fmt::Display| {
        let directory = directory.display();
        let text = format!("no recording in {directory}: {why} ({VARIABLE} names another, or off)");
        Failure::new(Why::System, text)
    };
    let plan = Plan::new(&threads, RING).map_err(|e| wrong(&e))?;
    let (file, memory) = LiveFile::create(&directory, plan.bytes).map_err(|e| wrong(&e))?;
    let program = std::env::current_exe().unwrap_or_default();
    let program = program.file_name().unwrap_or_default().to_string_lossy();
    let process = std::process::id();
    plan.write(&memory, &program, process, clocks(), &threads);
    Ok(Some(Recording {
        process,
        memory,
        plan,
        taken: AtomicUsize::new(0),
        names: Mutex::default(),
        _file: file,
    }))
}

//! The tools of every case: expectations, tasks, the order of events.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use firmware::say;
use replenish_os::freertos::tasks;
use replenish_os::{Nanos, Policy, Thread, ThreadSpec, Tid, current_tid, spawn};

pub const MS: Nanos = 1_000_000;
pub const US: Nanos = 1_000;

static FAILED: AtomicBool = AtomicBool::new(false);

/// Says what was wrong, and that the case has failed.
macro_rules! hold {
    ($what:expr, $($why:tt)*) => {
        if !$what {
            $crate::check::failed();
            firmware::say!("wrong: {}", format_args!($($why)*));
        }
    };
}
pub(crate) use hold;

pub fn failed() {
    FAILED.store(true, Ordering::SeqCst);
}

pub fn all_held() -> bool {
    !FAILED.load(Ordering::SeqCst)
}

/// A FIFO task with 4 kB of stack.
pub fn task<T: Send + 'static>(
    name: &str,
    priority: u8,
    body: impl FnOnce() -> T + Send + 'static,
) -> Thread<T> {
    let spec = ThreadSpec::new(name).policy(Policy::Fifo { priority });
    match spawn(spec.stack_size(4096), body) {
        Ok(thread) => thread,
        Err(e) => {
            say!("wrong: no task {name}: {e}");
            firmware::console::exit(false)
        }
    }
}

/// The value that the task returned; the case fails at once if the task panicked.
pub fn join<T>(thread: Thread<T>) -> T {
    match thread.join() {
        Ok(value) => value,
        Err(_) => {
            say!("wrong: a task has no result");
            firmware::console::exit(false)
        }
    }
}

/// The priority a task has now, inheritance included.
pub fn priority_of(tid: Tid) -> u8 {
    let found = tasks().find(|t| t.tid == tid);
    found.map_or(u8::MAX, |t| t.priority)
}

/// The calling task's.
pub fn my_priority() -> u8 {
    priority_of(current_tid())
}

/// In which order things happened.
#[derive(Clone)]
pub struct Order(Arc<(AtomicU32, [AtomicU32; 16])>);

impl Order {
    pub fn new() -> Self {
        Self(Arc::new((
            AtomicU32::new(0),
            [const { AtomicU32::new(0) }; 16],
        )))
    }

    pub fn note(&self, what: char) {
        let at = self.0.0.fetch_add(1, Ordering::SeqCst) as usize;
        if let Some(place) = self.0.1.get(at) {
            place.store(what as u32, Ordering::SeqCst);
        }
    }

    pub fn is(&self, wanted: &str) -> bool {
        let noted = self.0.1.iter().map(|c| c.load(Ordering::SeqCst));
        let mut noted = noted.take_while(|c| *c != 0).filter_map(char::from_u32);
        let same = wanted.chars().all(|c| noted.next() == Some(c)) && noted.next().is_none();
        if !same {
            let all = self.0.1.iter().map(|c| c.load(Ordering::SeqCst));
            for c in all.take_while(|c| *c != 0).filter_map(char::from_u32) {
                say!("noted: {c}");
            }
        }
        same
    }
}

//! Kernel thread ids.
#![expect(unsafe_code, reason = "gettid")]

use crate::Tid;
use std::cell::Cell;

thread_local! {
    static CACHE: Cell<i32> = const { Cell::new(0) };
}

/// The id of the calling thread: `gettid()` once per thread, then a thread-local read.
///
/// The cache does not survive `fork` without `exec`: the child would read its parent's id.
#[inline]
#[must_use]
pub fn current_tid() -> Tid {
    match CACHE.with(Cell::get) {
        0 => ask(),
        known => Tid::known(known),
    }
}

#[cold]
fn ask() -> Tid {
    // SAFETY: gettid has no arguments, touches no memory and cannot fail.
    let tid = unsafe { libc::gettid() };
    CACHE.with(|cache| cache.set(tid));
    Tid::known(tid)
}

/// Whether `tid` is a thread of this process, as far as `/proc` says. Allocates.
pub(crate) fn is_of_this_process(tid: Tid) -> bool {
    std::path::Path::new(&format!("/proc/self/task/{tid}")).exists()
}

/// Whether thread `tid` of this process runs on that CPU, or waits for nothing else than that CPU,
/// as far as `/proc` says (`proc_pid_stat(5)`, `state` and `processor`). Allocates.
pub(crate) fn wants_cpu(tid: Tid, cpu: usize) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/self/task/{tid}/stat"));
    let stat = stat.unwrap_or_default();
    // The name may contain anything; nothing behind it has a bracket.
    let mut fields = stat.rsplit(')').next().unwrap_or("").split_whitespace();
    fields.next() == Some("R") && fields.nth(PROCESSOR).and_then(|f| f.parse().ok()) == Some(cpu)
}

/// Fields of `stat` between `state` (3) and `processor` (39).
const PROCESSOR: usize = 39 - 3 - 1;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::affinity::{CpuSet, affinity, set_affinity};

    #[test]
    fn a_thread_that_runs_wants_its_cpu_and_one_that_waits_does_not() {
        let cpus = affinity(current_tid()).unwrap();
        let cpu = cpus.iter().next().unwrap();
        let (tell, told) = std::sync::mpsc::channel();
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::spawn(move || {
            set_affinity(current_tid(), &CpuSet::one(cpu)).unwrap();
            tell.send((current_tid(), wants_cpu(current_tid(), cpu)))
                .unwrap();
            assert!(!wants_cpu(current_tid(), cpu + 1));
            ended.recv().ok();
        });
        let (tid, wanted) = told.recv().unwrap();
        assert!(wanted);
        while wants_cpu(tid, cpu) {
            std::thread::yield_now();
        }
        drop(end);
        thread.join().unwrap();
        // The kernel wakes the joining thread a little before the thread is gone.
        while wants_cpu(tid, cpu) {
            std::thread::yield_now();
        }
    }

    #[test]
    fn ids_are_stable_distinct_and_known_to_the_kernel() {
        let here = current_tid();
        assert_eq!(here, current_tid());
        let there = std::thread::spawn(current_tid).join().unwrap();
        assert_ne!(here, there);
        assert!(is_of_this_process(here));
        // The kernel takes a thread out of the list after others see its end.
        let end = std::time::Instant::now() + std::time::Duration::from_secs(10);
        while is_of_this_process(there) {
            assert!(std::time::Instant::now() < end, "it has ended");
            std::thread::yield_now();
        }
        assert!(!is_of_this_process(Tid::known(2)), "a thread of the kernel");
    }
}

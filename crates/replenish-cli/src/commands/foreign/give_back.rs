//! Threads get back what they had, and so do those that have begun meanwhile.

use super::cgroup::Homes;
use replenish_os::Tid;
use replenish_os::foreign::{Original, family, restore, start_of, tasks};
use std::collections::BTreeMap;

/// By number: when a thread or process began, and what it had.
pub(super) type Held = BTreeMap<Tid, (u64, Original)>;

/// The threads and processes that get back their policy and CPUs.
#[derive(Debug, Clone, Default)]
pub(super) struct Charge {
    pub(super) threads: Held,
    /// The original policy and CPUs of the first thread of each process.
    pub(super) processes: Held,
    /// Threads without a budget that are as they want to be, and when they began.
    pub(super) alone: BTreeMap<Tid, u64>,
    /// Control groups, where threads are stopped.
    pub(super) homes: Homes,
}

impl Charge {
    /// Gives every thread back what it had. A thread that has ended, or whose number is another
    /// one's by now, is left alone.
    pub(super) fn give_back(&self, cpu: usize) {
        self.homes.send_back();
        for (tid, (start, original)) in &self.threads {
            restore(*tid, *start, original).ok(); // refused, there is nothing else to do
        }
        // Twice: a thread can be born between the creator's restoration and this.
        for _ in 0..2 {
            for (pid, (start, first)) in &self.processes {
                if start_of(*pid) == Some(*start) {
                    for process in family(*pid) {
                        self.settle_all(process, cpu, first);
                    }
                }
            }
        }
    }

    fn settle_all(&self, process: Tid, cpu: usize, first: &Original) {
        for tid in tasks(process).unwrap_or_default() {
            let held = self.threads.get(&tid).map(|(start, _)| start);
            let known = held.or_else(|| self.alone.get(&tid));
            if known.is_none_or(|start| start_of(tid) != Some(*start)) {
                settle(tid, cpu, first);
            }
        }
    }
}

/// A thread without a budget of its own does not keep the CPU and the class that it inherited from
/// one that has a budget; `first` is what the first thread of its program had.
pub(super) fn settle(tid: Tid, cpu: usize, first: &Original) {
    if let Ok(has) = Original::of(tid) {
        let own = has.without_inheritance(cpu, first);
        if own != has {
            own.apply(tid).ok(); // it has ended
        }
    }
}

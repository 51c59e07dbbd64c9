//! Execution time and releases of each callback, from the program's recording.
//!
//! ```text
//!   recording, four times a second ─► slices of each worker ─► Callback: histogram, windows
//! ```
//!
//! Of a worker with a budget the recording has the times off the CPU. Of another one it has a
//! reading of the CPU clock now and then: a callback took no more than the clock moved between the
//! readings around it, and no more than from its begin to its end.

use super::histogram::Histogram;
use super::rhythm::PERIODS;
use crate::live::timeline::{Facts, Slice, Timeline};
use crate::live::{Program, all};
use crate::time::{MS, Nanos};
use replenish_recorder::{NameKind, Role};
use std::collections::{BTreeMap, VecDeque};

/// Callbacks of a program that are looked at.
const MOST: usize = 4096;
/// Releases that are remembered at a time.
const REMEMBERED: usize = 100_000;

/// One callback of a worker.
#[derive(Debug, Clone, Default)]
pub(super) struct Callback {
    pub(super) id: String,
    pub(super) times: Histogram,
    first: Nanos,
    last: Nanos,
    /// Releases of the longest period, each with the CPU time before it.
    recent: VecDeque<(Nanos, Nanos)>,
    /// CPU time so far.
    sum: Nanos,
    /// By period: the most CPU time that the releases within any one took.
    most: [Nanos; PERIODS.len()],
}

/// One worker, by its recording.
#[derive(Debug, Clone)]
pub(super) struct Worker {
    pub(super) name: String,
    pub(super) callbacks: Vec<Callback>,
}

impl Callback {
    fn add(&mut self, release: Nanos, took: Nanos) {
        if self.times.count() == 0 {
            self.first = release;
        }
        self.times.add(took);
        // Of several samples that wait, a later one may have arrived earlier.
        self.last = self.last.max(release);
        self.recent.push_back((self.last, self.sum));
        self.sum = self.sum.saturating_add(took);
        let longest = PERIODS.last().map_or(0, |longest| longest * MS);
        let is_old = |(at, _): &(Nanos, Nanos)| at.saturating_add(longest) < self.last;
        while self.recent.front().is_some_and(is_old) || self.recent.len() > REMEMBERED {
            self.recent.pop_front();
        }
        for (most, period) in self.most.iter_mut().zip(PERIODS) {
            // An execution that begins a tenth of a period early belongs to the next one.
            let length = period * MS * 9 / 10;
            let before = |(at, _): &(Nanos, Nanos)| at.saturating_add(length) <= self.last;
            let inside = self.recent.partition_point(before);
            if let Some((_, sum)) = self.recent.get(inside) {
                *most = (*most).max(self.sum.saturating_sub(*sum));
            }
        }
    }

    /// The mean time between two releases; `None` for fewer than two.
    pub(super) fn interval(&self) -> Option<Nanos> {
        let between = self.times.count().checked_sub(1).filter(|n| *n > 0)?;
        Some(self.last.saturating_sub(self.first) / between)
    }

    /// The longest of the periods that are suggested which is not longer than its own; of a
    /// callback that hardly came, the longest of all.
    pub(super) fn period(&self) -> Nanos {
        let fits = |period: &&u64| {
            let interval = self.interval().unwrap_or(Nanos::MAX);
            **period * MS <= interval.saturating_add(interval / 20)
        };
        let period = PERIODS.iter().rev().find(fits);
        period.or(PERIODS.first()).map_or(MS, |period| period * MS)
    }

    /// The most CPU time that its releases within any `period` took.
    pub(super) fn most_in(&self, period: Nanos) -> Nanos {
        let mut known = self.most.iter().zip(PERIODS);
        let known = known.find(|(_, known)| *known * MS >= period);
        known.map_or(self.times.most, |(most, _)| *most)
    }
}

impl Worker {
    /// The shortest period of its callbacks.
    pub(super) fn period(&self) -> Nanos {
        let periods = self.callbacks.iter().map(Callback::period);
        periods.min().unwrap_or(MS)
    }

    /// Largest CPU time of each callback in any `period`, added up over the callbacks.
    pub(super) fn most_in(&self, period: Nanos) -> Nanos {
        let most = self.callbacks.iter().map(|c| c.most_in(period));
        most.fold(0, Nanos::saturating_add)
    }

    pub(super) fn executions(&self) -> u64 {
        self.callbacks.iter().map(|c| c.times.count()).sum()
    }
}

/// A worker's place: its program's start, and its number.
type Place = (Nanos, usize);

/// The callbacks of one process.
#[derive(Debug, Default)]
pub(super) struct Follower {
    callbacks: BTreeMap<(Place, u32), Callback>,
    /// Of each worker: its name, and the end of the last callback that was counted.
    workers: BTreeMap<Place, (String, Nanos)>,
}

impl Follower {
    /// Takes what the recordings of this process have that is new; returns its threads with their
    /// whole names.
    pub(super) fn look(&mut self, pid: u32) -> Vec<(u32, String)> {
        let programs = all().programs.into_iter();
        let mut threads = Vec::new();
        for program in programs.filter(|p| p.alive && p.view.pid == pid) {
            for thread in &program.view.threads {
                let tid = u32::try_from(thread.tid);
                threads.extend(tid.map(|tid| (tid, thread.name.clone())));
            }
            self.program(&program);
        }
        threads
    }

    fn program(&mut self, program: &Program) {
        let names = program.view.names(&program.source);
        let start = program.view.clocks.monotonic;
        for (n, thread) in program.view.threads.iter().enumerate() {
            if thread.role != Role::Worker {
                continue;
            }
            let (events, first) = thread.events(&program.source);
            let (budget, second) = thread.budget_events(&program.source);
            let facts = Facts {
                budget: thread.budget,
                ..Facts::default()
            };
            let overwritten = [first.overwritten > 0, second.overwritten > 0];
            let timeline = Timeline::new(facts, &events, &budget, overwritten);
            let place = (start, n);
            let (_, counted) = self
                .workers
                .entry(place)
                .or_insert_with(|| (thread.name.clone(), 0));
            let from = *counted;
            for slice in timeline.slices.iter().filter(|s| s.time.to > from) {
                let Some(took) = took(&timeline, slice) else {
                    break; // more is known at the next look
                };
                *counted = slice.time.to;
                let id = names.get(slice.handle as usize).cloned().flatten();
                let Some((NameKind::Handle, id)) = id else {
                    continue;
                };
                let key = (place, slice.handle);
                if self.callbacks.len() < MOST || self.callbacks.contains_key(&key) {
                    let callback = self.callbacks.entry(key).or_default();
                    callback.id = id;
                    callback.add(slice.release, took);
                }
            }
        }
    }

    /// The workers whose callbacks have run, by name.
    pub(super) fn workers(self) -> Vec<Worker> {
        let mut callbacks = self.callbacks;
        let mut workers = BTreeMap::<String, Worker>::new();
        for (place, (name, _)) in self.workers {
            let rest = callbacks.split_off(&(place, 0));
            let mut own = Vec::new();
            for ((at, handle), callback) in rest {
                if at == place {
                    own.push(callback);
                } else {
                    callbacks.insert((at, handle), callback);
                }
            }
            if !own.is_empty() {
                let worker = Worker {
                    name: name.clone(),
                    callbacks: own,
                };
                workers.insert(name, worker); // of two starts, the later one
            }
        }
        workers.into_values().collect()
    }
}

/// The CPU time of a callback that has ended; `None` if that cannot be said yet.
fn took(timeline: &Timeline, slice: &Slice) -> Option<Nanos> {
    let whole = slice.time;
    if whole.to == Nanos::MAX {
        return None;
    }
    let length = whole.to.saturating_sub(whole.from);
    if timeline.exact {
        return Some(timeline.on_cpu(whole));
    }
    let readings = &timeline.used;
    let after = readings.partition_point(|(time, _)| *time < whole.to);
    let before = readings.iter().take(after).rev();
    let before = before.filter(|(time, _)| *time <= whole.from).map(|r| r.1);
    let moved = before
        .max()
        .zip(readings.get(after))
        .map(|(first, (_, second))| second.saturating_sub(first));
    Some(moved.map_or(length, |moved| moved.min(length)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_callback_has_its_own_period_and_the_most_of_any_such_period() {
        let mut callback = Callback::default();
        for n in 0..100 {
            // Every 20 ms, a little early or late; once twice as long, once twice in a period.
            let jitter = if n % 2 == 0 { MS } else { 0 };
            let took = if n == 40 { 4 * MS } else { 2 * MS };
            callback.add(1000 * MS + n * 20 * MS + jitter, took);
        }
        assert_eq!(callback.period(), 20 * MS);
        assert_eq!(callback.most_in(20 * MS), 4 * MS);
        assert_eq!(callback.most_in(100 * MS), (4 + 4 * 2) * MS);
        assert_eq!(callback.most_in(5 * MS), 4 * MS);
        let last = callback.last;
        callback.add(last + 2 * MS, MS);
        assert_eq!(callback.most_in(20 * MS), 4 * MS, "3 are less");
        callback.add(last + 3 * MS, 3 * MS);
        assert_eq!(callback.most_in(20 * MS), 6 * MS);
        assert_eq!(callback.times.count(), 102);
        assert_eq!(callback.times.percentile(100), 4 * MS);
        assert!(callback.recent.len() <= 30);
        assert_eq!(Callback::default().period(), 500 * MS);
    }

    #[test]
    fn two_callbacks_of_a_worker_add_up_in_the_shorter_period() {
        let mut callbacks = [Callback::default(), Callback::default()];
        for n in 0..50 {
            callbacks[0].add(n * 10 * MS, MS);
            callbacks[1].add(n * 100 * MS, 3 * MS);
        }
        let worker = Worker {
            name: "w".into(),
            callbacks: callbacks.into(),
        };
        assert_eq!(worker.period(), 10 * MS);
        assert_eq!(worker.most_in(10 * MS), 4 * MS);
        assert_eq!(worker.executions(), 100);
    }
}

//! How much CPU time the threads of a process take, as the kernel tells everybody: sampled from
//! `/proc/PID/task/TID/schedstat`. Nothing in the program has to be prepared for it.
//!
//! The kernel brings the number of a thread that runs up to date at its timer tick (1 to 10 ms) and
//! whenever it stops running, so a window can be off by that much at each end.

use crate::time::Nanos;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;

/// One thread's consumption so far.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    /// Its name; the kernel keeps 15 bytes.
    pub(super) name: String,
    /// CPU times at the latest samples, within one window: (time, CPU time).
    recent: VecDeque<(Nanos, Nanos)>,
    /// The most it has taken in a window.
    pub(super) most: Nanos,
    /// Windows looked at: each sample ends one.
    pub(super) windows: u64,
    /// Threads of this name, one after another or side by side.
    pub(super) threads: u64,
    first: (Nanos, Nanos),
    last: (Nanos, Nanos),
}

impl Seen {
    fn new(name: String, at: (Nanos, Nanos)) -> Self {
        Self {
            name,
            recent: VecDeque::new(),
            most: 0,
            windows: 0,
            threads: 1,
            first: at,
            last: at,
        }
    }

    fn sample(&mut self, now: Nanos, cpu: Nanos, window: Nanos) {
        self.last = (now, cpu);
        self.recent.push_back((now, cpu));
        // The oldest sample that is a whole window ago stays.
        while self.recent.get(1).is_some_and(|(t, _)| now - t >= window) {
            self.recent.pop_front();
        }
        if let Some(&(from, before)) = self.recent.front()
            && now - from >= window
        {
            // A late sample makes the window longer; what is more is taken as evenly spread.
            let used = u128::from(cpu.saturating_sub(before)) * u128::from(window);
            let used = used / u128::from((now - from).max(1));
            self.most = self.most.max(Nanos::try_from(used).unwrap_or(Nanos::MAX));
            self.windows += 1;
        }
    }

    fn join(&mut self, other: Self) {
        let (windows, threads) = (self.windows + other.windows, self.threads + other.threads);
        if other.most > self.most {
            *self = other;
        }
        (self.windows, self.threads) = (windows, threads);
    }

    /// The share of one CPU it took all in all, in percent.
    pub(super) fn percent(&self) -> f64 {
        let (from, before) = self.first;
        let (to, after) = self.last;
        after.saturating_sub(before) as f64 * 100.0 / to.saturating_sub(from).max(1) as f64
    }
}

/// The threads of one process.
#[derive(Debug)]
pub(super) struct Observer {
    tasks: PathBuf,
    main: u32,
    window: Nanos,
    threads: BTreeMap<u32, Seen>,
}

impl Observer {
    /// Looks at this process in windows of this length.
    pub(super) fn new(pid: u32, window: Nanos) -> Self {
        Self {
            tasks: PathBuf::from(format!("/proc/{pid}/task")),
            main: pid,
            window,
            threads: BTreeMap::new(),
        }
    }

    /// Takes a sample of every thread; `false` if the process is gone.
    pub(super) fn sample(&mut self, now: Nanos) -> bool {
        let Ok(tasks) = std::fs::read_dir(&self.tasks) else {
            return false;
        };
        let mut any = false;
        for task in tasks.flatten() {
            let Some(tid) = task.file_name().to_str().and_then(|n| n.parse().ok()) else {
                continue;
            };
            let read = |file: &str| std::fs::read_to_string(task.path().join(file)).ok();
            let Some(cpu) = read("schedstat").and_then(|text| cpu_time(&text)) else {
                continue;
            };
            any = true;
            let seen = self.threads.entry(tid).or_insert_with(|| {
                let name = read("comm").unwrap_or_default();
                Seen::new(name.trim_end().to_string(), (now, cpu))
            });
            seen.sample(now, cpu, self.window);
        }
        any
    }

    /// The threads except the process's first one and those that an executor brings along itself,
    /// by name: of several threads of one name, the hungriest speaks for all. Threads that were not
    /// given a name, and so have that of the program, count only if there are no others.
    pub(super) fn workers(mut self) -> Vec<Seen> {
        let program = self.threads.remove(&self.main).map(|main| main.name);
        let mut by_name = BTreeMap::<String, Seen>::new();
        for seen in self.threads.into_values() {
            if seen.name == "dispatcher" || seen.name.starts_with("enforcer") || seen.windows == 0 {
                continue;
            }
            match by_name.entry(seen.name.clone()) {
                Entry::Vacant(place) => drop(place.insert(seen)),
                Entry::Occupied(mut place) => place.get_mut().join(seen),
            }
        }
        if let Some(program) = program.filter(|_| by_name.len() > 1) {
            by_name.remove(&program);
        }
        by_name.into_values().collect()
    }
}

/// The first field: CPU time in ns.
fn cpu_time(schedstat: &str) -> Option<Nanos> {
    schedstat.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Nanos = 1_000_000;

    #[test]
    fn the_most_of_any_window_is_found_wherever_it_begins() {
        let mut seen = Seen::new("w".into(), (0, 0));
        let mut cpu = 0;
        for step in 0..=100 {
            // 1 ms in every 10, but 5 in each of the four steps from 33 on.
            cpu += if (33..37).contains(&step) { 5 } else { 1 } * MS;
            seen.sample(step * 10 * MS, cpu, 100 * MS);
        }
        assert_eq!(seen.most, (4 * 5 + 6) * MS);
        assert_eq!(seen.windows, 91);
        assert!(seen.recent.len() <= 12);
    }

    #[test]
    fn schedstat_begins_with_the_cpu_time() {
        assert_eq!(cpu_time("123456 789 3\n"), Some(123_456));
        assert_eq!(cpu_time(""), None);
    }

    #[test]
    fn a_process_that_is_gone_is_no_sample() {
        assert!(!Observer::new(u32::MAX, MS).sample(0));
    }
}

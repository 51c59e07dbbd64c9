//! CPU time of a process's threads, as the kernel tells everybody: sampled from
//! `/proc/PID/task/TID/schedstat`. Nothing in the program has to be prepared for it.
//!
//! The kernel brings the number of a thread that runs up to date at its timer tick (1 to 10 ms) and
//! whenever it stops running, so a window can be off by that much at each end.

use super::rhythm::{Rhythm, Sample};
use crate::time::Nanos;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::PathBuf;

/// The kernel keeps so many bytes of a thread's name.
const KEPT: usize = 15;

/// One thread's consumption so far.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    /// Its name: whole if the program has a recording that says it, else what the kernel keeps.
    pub(super) name: String,
    pub(super) rhythm: Rhythm,
    /// The most it has taken in any of its periods.
    pub(super) most: Nanos,
    /// Its period.
    pub(super) period: Nanos,
    /// Periods looked at.
    pub(super) windows: u64,
    /// Threads of this name, one after another or side by side.
    pub(super) threads: u64,
}

impl Seen {
    /// `None` if it was not looked at for a whole period.
    fn new(name: String, rhythm: Rhythm) -> Option<Self> {
        let window = rhythm.window()?;
        Some(Self {
            name,
            rhythm,
            most: window.most,
            period: window.length,
            windows: window.count,
            threads: 1,
        })
    }

    fn join(&mut self, other: Self) {
        let (windows, threads) = (self.windows + other.windows, self.threads + other.threads);
        let load = |seen: &Self| u128::from(seen.most) * 1_000_000 / u128::from(seen.period.max(1));
        if load(&other) > load(self) {
            *self = other;
        }
        (self.windows, self.threads) = (windows, threads);
    }

    /// Whether the kernel may have cut its name.
    pub(super) fn may_be_cut(&self) -> bool {
        is_cut(&self.name)
    }
}

/// The threads of one process.
#[derive(Debug)]
pub(super) struct Observer {
    tasks: PathBuf,
    main: u32,
    period: Option<Nanos>,
    /// Names as the kernel has them.
    threads: BTreeMap<u32, (String, Rhythm)>,
}

impl Observer {
    /// Looks at this process in periods of this length; without one, in each thread's own.
    pub(super) fn new(pid: u32, period: Option<Nanos>) -> Self {
        Self {
            tasks: PathBuf::from(format!("/proc/{pid}/task")),
            main: pid,
            period,
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
            let waits = read("status").and_then(|text| waits(&text)).unwrap_or(0);
            let sample = Sample {
                time: now,
                cpu,
                waits,
            };
            let (_, rhythm) = self.threads.entry(tid).or_insert_with(|| {
                let name = std::fs::read(task.path().join("comm")).unwrap_or_default();
                (text(&name), Rhythm::new(self.period, sample))
            });
            rhythm.sample(sample);
        }
        any
    }

    /// The threads except the process's first one and those that an executor brings along itself,
    /// by name: of several threads of one name, the hungriest speaks for all. Threads that were not
    /// given a name, and so have that of the program, count only if there are no others.
    pub(super) fn workers(mut self, recorded: &[(u32, String)]) -> Vec<Seen> {
        let program = self.threads.remove(&self.main).map(|(name, _)| name);
        let mut by_name = BTreeMap::<String, Seen>::new();
        for (tid, (name, rhythm)) in self.threads {
            if name == "dispatcher" || name.starts_with("enforcer") {
                continue;
            }
            let Some(seen) = Seen::new(whole(tid, name, recorded), rhythm) else {
                continue;
            };
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

/// Whether a name is as long as the kernel keeps it; a character of up to four bytes may be gone.
fn is_cut(name: &str) -> bool {
    (KEPT - 3..=KEPT).contains(&name.len()) && (name.len() == KEPT || !name.is_ascii())
}

/// The whole name of a thread whose name the kernel may have cut.
fn whole(tid: u32, name: String, recorded: &[(u32, String)]) -> String {
    let of = |(t, whole): &&(u32, String)| *t == tid && whole.starts_with(&name);
    match recorded.iter().find(of) {
        Some((_, whole)) if is_cut(&name) => whole.clone(),
        _ => name,
    }
}

/// A thread's name without a character that the kernel has cut in two.
fn text(comm: &[u8]) -> String {
    let name = String::from_utf8_lossy(comm);
    name.trim_end().trim_end_matches('\u{fffd}').to_string()
}

/// Times that a thread has given the CPU back by itself.
fn waits(status: &str) -> Option<u64> {
    let mut lines = status.lines();
    let count = lines.find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"))?;
    count.trim().parse().ok()
}

/// The first field: CPU time in ns.
fn cpu_time(schedstat: &str) -> Option<Nanos> {
    schedstat.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_completes_a_cut_name() {
        let recorded = [(7, "camera_pipeline_left".to_string())];
        let whole = |tid, name: &str| whole(tid, name.to_string(), &recorded);
        assert_eq!(whole(7, "camera_pipeline"), "camera_pipeline_left");
        assert_eq!(whole(8, "camera_pipeline"), "camera_pipeline");
        assert_eq!(whole(7, "another_thread_"), "another_thread_");
        assert_eq!(whole(7, "camera"), "camera");
        assert_eq!(text(b"name\n"), "name");
        assert_eq!(
            text("größe_der_größe".as_bytes().get(..15).unwrap()),
            "größe_der_gr"
        );
        assert!(is_cut("größe_der_gr") && !is_cut("camera_left_"));
    }

    #[test]
    fn waits_are_voluntary_switches() {
        let status = "Name:\tx\nvoluntary_ctxt_switches:\t42\nnonvoluntary_ctxt_switches:\t7\n";
        assert_eq!(waits(status), Some(42));
        assert_eq!(waits("nonvoluntary_ctxt_switches:\t7\n"), None);
    }

    #[test]
    fn schedstat_begins_with_the_cpu_time() {
        assert_eq!(cpu_time("123456 789 3\n"), Some(123_456));
        assert_eq!(cpu_time(""), None);
    }

    #[test]
    fn a_process_that_is_gone_is_no_sample() {
        assert!(!Observer::new(u32::MAX, None).sample(0));
    }
}

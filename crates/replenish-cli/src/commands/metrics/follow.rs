//! The counts of handles, from the recordings: each look takes the events since the look before.

use crate::live::{Found, Program, all};
use crate::time::Nanos;
use replenish_recorder::{Event, Kind, ThreadView};
use std::collections::{HashMap, HashSet};
use std::path::PathBuf;

/// Upper bounds of the buckets of responses, ns, and as the format writes them, in seconds.
pub(super) const BUCKETS: [(Nanos, &str); 14] = [
    (100_000, "0.0001"),
    (200_000, "0.0002"),
    (500_000, "0.0005"),
    (1_000_000, "0.001"),
    (2_000_000, "0.002"),
    (5_000_000, "0.005"),
    (10_000_000, "0.01"),
    (20_000_000, "0.02"),
    (50_000_000, "0.05"),
    (100_000_000, "0.1"),
    (200_000_000, "0.2"),
    (500_000_000, "0.5"),
    (1_000_000_000, "1.0"),
    (Nanos::MAX, "+Inf"),
];
/// Handles that are counted; events of further ones are not.
const MOST_HANDLES: usize = 10_000;

/// One start of a program: its file, its process id, and the clock at its start.
pub(super) type Run = (PathBuf, u32, Nanos);

/// A handle of one thread, by the id of its name. Drops are counted at the dispatcher.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Key {
    /// The thread's place in its file.
    pub(super) thread: usize,
    pub(super) name: u32,
}

/// Counts of one handle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) executions: u64,
    /// Callbacks that ended after their deadline.
    pub(super) misses: u64,
    /// Samples that found no room.
    pub(super) drops: u64,
    pub(super) panics: u64,
    /// Responses, from release to end: in each bucket alone, and their sum in ns.
    pub(super) responses: [u64; BUCKETS.len()],
    pub(super) sum: Nanos,
}

impl Counts {
    fn add(&mut self, event: &Event) {
        match event.kind {
            Kind::End => {
                self.executions += 1;
                let response = event.time.saturating_sub(event.a);
                self.sum = self.sum.saturating_add(response);
                let mut buckets = self.responses.iter_mut().zip(BUCKETS);
                if let Some((count, _)) = buckets.find(|(_, (most, _))| response <= *most) {
                    *count += 1;
                }
            }
            Kind::Miss => self.misses += 1,
            Kind::Drop => self.drops += 1,
            Kind::Panic => self.panics += 1,
            _ => {}
        }
    }
}

/// The counts of one start of a program.
#[derive(Debug, Default)]
pub(super) struct Counted {
    /// The next event of each thread.
    next: Vec<u64>,
    pub(super) handles: HashMap<Key, Counts>,
    /// Events that were overwritten before they were counted.
    pub(super) missed: u64,
}

/// Counts from look to look.
#[derive(Debug)]
pub(super) struct Follower {
    ended: bool,
    counted: HashMap<Run, Counted>,
}

/// The start of a program that a recording belongs to.
fn run(program: &Program) -> Run {
    let view = &program.view;
    (program.path.clone(), view.pid, view.clocks.monotonic)
}

impl Follower {
    /// `ended`: programs that have ended, too.
    pub(super) fn new(ended: bool) -> Self {
        Self {
            ended,
            counted: HashMap::new(),
        }
    }

    /// Takes what has happened since the look before; what is gone is forgotten.
    pub(super) fn look(&mut self) -> Found {
        let mut found = all();
        found.programs.retain(|p| p.alive || self.ended);
        let runs: Vec<Run> = found.programs.iter().map(run).collect();
        let here: HashSet<&Run> = runs.iter().collect();
        self.counted.retain(|key, _| here.contains(key));
        let mut room = MOST_HANDLES;
        for counted in self.counted.values() {
            room = room.saturating_sub(counted.handles.len());
        }
        for (program, run) in found.programs.iter().zip(runs) {
            let counted = self.counted.entry(run).or_default();
            let threads = &program.view.threads;
            counted.next.resize(threads.len(), 0);
            for (n, thread) in threads.iter().enumerate() {
                counted.take(n, thread, program, &mut room);
            }
        }
        found
    }

    /// The counts of this program so far.
    pub(super) fn counted(&self, program: &Program) -> Option<&Counted> {
        self.counted.get(&run(program))
    }
}

impl Counted {
    fn take(&mut self, n: usize, thread: &ThreadView, program: &Program, room: &mut usize) {
        let Some(next) = self.next.get_mut(n) else {
            return;
        };
        let (events, copied) = thread.events_since(&program.source, *next);
        self.missed = self.missed.saturating_add(copied.overwritten);
        *next = copied.next.max(*next);
        for gap in events.iter().filter(|e| e.kind == Kind::Gap) {
            self.missed = self.missed.saturating_add(gap.a);
        }
        let counts =
            |e: &&Event| matches!(e.kind, Kind::End | Kind::Miss | Kind::Drop | Kind::Panic);
        for event in events.iter().filter(counts) {
            let key = Key {
                thread: n,
                name: event.name,
            };
            if !self.handles.contains_key(&key) {
                if *room == 0 {
                    continue;
                }
                *room -= 1;
            }
            self.handles.entry(key).or_default().add(event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(kind: Kind, time: Nanos, a: Nanos) -> Event {
        Event {
            time,
            kind,
            name: 1,
            a,
            b: 0,
        }
    }

    #[test]
    fn a_response_stands_in_the_first_bucket_that_holds_it() {
        let mut counts = Counts::default();
        for (time, release) in [(100_000, 0), (100_001, 0), (5, 10), (u64::MAX, 0)] {
            counts.add(&event(Kind::End, time, release));
        }
        assert_eq!(counts.executions, 4);
        assert_eq!((counts.responses[0], counts.responses[1]), (2, 1));
        assert_eq!(counts.responses[BUCKETS.len() - 1], 1);
        assert_eq!(counts.responses.iter().sum::<u64>(), 4);
        assert_eq!(counts.sum, u64::MAX);
        for kind in [Kind::Miss, Kind::Drop, Kind::Drop, Kind::Panic, Kind::Begin] {
            counts.add(&event(kind, 1, 0));
        }
        assert_eq!((counts.misses, counts.drops, counts.panics), (1, 2, 1));
    }

    #[test]
    fn bounds_of_buckets_are_what_they_say() {
        for (bound, text) in &BUCKETS[..BUCKETS.len() - 1] {
            let said = text.parse::<f64>().unwrap() * 1e9;
            assert!((said - *bound as f64).abs() < 1e-3, "{text}");
        }
        assert!(BUCKETS.is_sorted());
    }
}
